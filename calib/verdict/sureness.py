"""Whether there are views enough: by their number against that of the unknowns, and by how sure the
maps are.
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from calib.apply.map_uncertainty import ray_errors
from calib.calibration import Calibration
from calib.corners.view import pose_labels
from calib.inference.calibration_model import base_model
from calib.intrinsics.advice import TILT
from calib.session.session import MIN_FIT_VIEWS
from calib.verdict.case import Case
from calib.verdict.thresholds import FIGURE_UNKNOWNS, TELLS, UNSURE, UNSURE_FOCAL
from calib.verdict.verdict import Reason

SAMPLED = 300
"""Corners at which the standard deviation is asked."""


def too_few_views(case: Case) -> Iterator[Reason]:
    """A number with a tolerance is no unknown: where it is hardly told, it stays near what is
    declared, and sigma counts that.
    """
    calibration = case.calibration
    own = (
        len(base_model(calibration).parameters.free)
        if calibration.settings.get("intrinsics_from") == "views"
        else 0
    )
    unknowns = own + (FIGURE_UNKNOWNS if calibration.relief else 0)
    wanted = math.ceil(unknowns / TELLS)
    poses = int(pose_labels(calibration.views).max()) + 1
    if poses < wanted:
        said = (
            f"{poses} poses of the board are few for {unknowns} unknown numbers of camera and"
            f" glass: {wanted} are the least that can tell them."
        )
        yield Reason(said, case.next.capture())
    elif poses < MIN_FIT_VIEWS:
        said = (
            f"{len(calibration.views)} views show {poses} pose{'s' * (poses > 1)} of the board, and"
            " copies of one picture tell no more than that picture: move the board between the"
            f" pictures, to {MIN_FIT_VIEWS} poses or more."
        )
        yield Reason(said, case.next.capture())


def unsure_focal_length(case: Case) -> Iterator[Reason]:
    """Of a camera without a cover, whose maps have no standard deviation of their own."""
    k = case.calibration.camera.intrinsics
    if (
        not k
        or case.calibration.settings.get("intrinsics_from") != "views"
        or case.calibration.covariance.size
    ):
        return
    numbers = {"camera.fx": k.fx, "camera.fy": k.fy}
    unsure = {
        name: number.sigma / number.value
        for name, number in numbers.items()
        if number.sigma > UNSURE_FOCAL * number.value
    }
    if unsure:
        worst = max(unsure, key=lambda name: unsure[name])
        said = (
            f"the focal length is known to {100 * unsure[worst]:.2g} % only"
            f" ({numbers[worst].value:.0f} ± {numbers[worst].sigma:.2g} px), and so are metres that"
            f" are measured with it: {TILT}."
        )
        yield Reason(said, case.next.capture(), tuple(unsure))


def unsure_maps(case: Case) -> Iterator[Reason]:
    unsure = {
        depth: sigma
        for depth, sigma in map_sigmas(case.calibration, case.usual_depths).items()
        if sigma > UNSURE
    }
    if unsure:
        at = ", ".join(f"{sigma:.2g} px at {depth:g} m" for depth, sigma in unsure.items())
        said = (
            f"the maps are hardly known even at the corners (one standard deviation: {at}): take"
            " more views, tilted and near."
        )
        yield Reason(said, case.next.capture())


def map_sigmas(calibration: Calibration, depths: Sequence[float]) -> dict[float, float]:
    """By depth (m): the maps' predicted standard deviation (px), the median over the corners; empty
    where the fit has no covariance.
    """
    spread = _spread(calibration)
    if not spread.size:
        return {}
    of_map = {depth: spread[:, :2] + spread[:, 2:] / depth for depth in depths}
    return {
        depth: float(np.nanmedian(np.sqrt((off**2).sum((1, 2))))) for depth, off in of_map.items()
    }


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _spread(calibration: Calibration) -> NDArray[np.float64]:
    """Return the (n, 4, S) errors of the rays of some corners; for a wide lens, of corners that its
    undistorted picture holds.
    """
    pixels = calibration.observations.pixels.numpy()
    if calibration.model()[0].lens.wide:
        pixels = pixels[calibration.ray_field().holds(pixels)]
    return ray_errors(calibration)(pixels[:: max(1, len(pixels) // SAMPLED)])
