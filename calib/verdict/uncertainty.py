"""Checks: enough views, by the number of unknowns and by the uncertainty of focal length and
maps.
"""

import math
from collections.abc import Iterator

import numpy as np

from calib.apply.map_uncertainty import describe_sigmas, map_sigmas
from calib.calibration import Calibration
from calib.corners.view import pose_labels
from calib.fitting.corner_range import corners_at, distance_range
from calib.inference.calibration_model import base_model
from calib.intrinsics.advice import TILT
from calib.rounding import with_sigma
from calib.session.numbers import unknown_names
from calib.session.parameter_names import CAMERA
from calib.session.session import MIN_FIT_VIEWS
from calib.verdict.case import Case
from calib.verdict.thresholds import FIGURE_UNKNOWNS, TELLS, UNSURE, UNSURE_FOCAL
from calib.verdict.verdict import Reason


def too_few_views(case: Case) -> Iterator[Reason]:
    """Check the number of views. A number with a tolerance does not count as unknown: without
    evidence it stays near its declared value, which sigma includes. A single view of a target that
    is not flat may be enough.
    """
    calibration = case.calibration
    if not calibration.board.is_flat:
        return
    lens_unknowns = (
        len(base_model(calibration).parameters.free)
        if calibration.outcome.intrinsics_from == "views"
        else 0
    )
    declared = calibration.declared
    lens_unknowns += len(unknown_names(declared.intrinsics, declared.cover))
    unknowns = lens_unknowns + (FIGURE_UNKNOWNS if calibration.relief else 0)
    required = math.ceil(unknowns / TELLS)
    poses = int(pose_labels(calibration.views).max()) + 1
    if poses < required:
        sentence = (
            f"{poses} poses of the board are too few: {unknowns} unknown numbers of camera and"
            f" glass need at least {required}. Take {required - poses} more, tilted."
        )
        yield Reason(sentence, case.next.capture())
    elif poses < MIN_FIT_VIEWS:
        sentence = (
            f"{len(calibration.views)} views show {poses} pose{'s' * (poses > 1)} of the board, and"
            " a copy of a picture adds nothing: move the board between the pictures, to"
            f" {MIN_FIT_VIEWS} poses or more."
        )
        yield Reason(sentence, case.next.capture())


def uncertain_focal_length(case: Case) -> Iterator[Reason]:
    """Check the focal length of a camera without a cover, whose maps have no standard deviation."""
    k = case.calibration.camera.intrinsics
    if (
        not k
        or case.calibration.outcome.intrinsics_from != "views"
        or case.calibration.covariance.size
    ):
        return
    numbers = {CAMERA.fx: k.fx, CAMERA.fy: k.fy}
    uncertain = {
        name: number.sigma / number.value
        for name, number in numbers.items()
        if number.sigma > UNSURE_FOCAL * number.value
    }
    if uncertain:
        worst = max(uncertain, key=lambda name: uncertain[name])
        focal = with_sigma(numbers[worst].value, numbers[worst].sigma)
        sentence = (
            f"the focal length is known to {100 * uncertain[worst]:.2g} % only"
            f" ({focal} px), and so is every length that you measure: {TILT}."
        )
        yield Reason(sentence, case.next.capture(), tuple(uncertain))


def uncertain_maps(case: Case) -> Iterator[Reason]:
    uncertain = {
        depth: sigma
        for depth, sigma in map_sigmas(case.calibration, case.usual_depths).items()
        if sigma > UNSURE
    }
    if uncertain:
        listed = describe_sigmas(uncertain)
        sentence = (
            f"the maps are uncertain even where the board was (one standard deviation: {listed}):"
            " take more views, tilted and near."
        )
        yield Reason(sentence, case.next.capture())


def reached_depths(calibration: Calibration) -> tuple[float, ...]:
    """Return the distances in m of the nearest, the median and the farthest corner, rounded to two
    digits.
    """
    distance = corners_at(calibration)[:, 2]
    distance = distance[np.isfinite(distance)]
    if not distance.size:
        return ()
    near, far = distance_range(distance)
    rounded = (float(f"{depth:.2g}") for depth in (near, np.median(distance), far))
    return tuple(dict.fromkeys(rounded))
