"""The number of OpenCV's lens coefficients that the views ask for.

Each number is fitted jointly with the poses and the board's bend, because a bent board that is
taken as flat asks for coefficients that the lens does not have. A further coefficient has to make
the corners more probable, lower the error on held-out views, and stay within what lenses can be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from calib.corners.view import View, pose_labels
from calib.effects.board_shape import DEGREES, BoardShape
from calib.errors import NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit, Start
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.poses import opencv_intrinsics
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals
from calib.inference.cross_validation import Split, fold_split, hold_out
from calib.intrinsics.flat_views import FLAT_DEG
from calib.intrinsics.opencv_by_rays import prior_means
from calib.intrinsics.opencv_fit import OpenCVFit, has_pole
from calib.intrinsics.opencv_lens import PRISM_COUNT, refine_opencv
from calib.intrinsics.ray_lens import PLAIN
from calib.intrinsics.ray_lens_fit import fit_lens
from calib.intrinsics.spatial_target import spread_deg
from calib.optics.build import pinhole_path
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.freeing import own_coefficient_sigmas
from calib.session.lens import COEFFICIENTS, FISHEYE, NAMES, OPENCV
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from calib.session.tolerances import SENSOR_TILT, TANGENTIAL, THIN_PRISM
from calib.threads import single_thread

RATIONAL_COUNT = 8
"""The most coefficients with which OpenCV's own fit gives the start: with more, it takes minutes.
"""
MIN_PRISM_IMPROVEMENT = 0.05
"""The part of the held-out error by which a thin prism or a tilted sensor must lower it: few lenses
have them, and an uneven print gives them 2 to 6 %.
"""
CLEAR_RATIO = 0.7
"""If the error of all views falls below this fraction, that on held-out views falls as well: a few
coefficients cannot fit the noise of hundreds of corners.
"""
MIN_LOG_ODDS = math.log(100)
"""The least log Bayes factor by which more coefficients must make the corners more probable."""
MAX_SIGMAS = 3.0
"""Standard deviations of its prior beyond which a number is not one of a lens: it imitates
something else.
"""
FOCAL_SPREAD = 0.3
"""Standard deviation of the prior of a focal length, relative to that of the first fit."""
CENTRE_SPREAD = 0.03
"""Standard deviation of the prior of the principal point around the middle, relative to the longer
side of the picture: sensors and lenses are centred to a few hundredths of it.
"""
WIDE = math.radians(40)
"""The angle of the picture's corner from the axis beyond which a lens may be a fisheye."""
MIN_SEEN = 0.99
"""The least fraction of the corners that a lens must see."""
SPREADS = {
    **dict.fromkeys(("p1", "p2"), TANGENTIAL.sigma),
    **dict.fromkeys(("s1", "s2", "s3", "s4"), THIN_PRISM.sigma),
    **dict.fromkeys(("tau_x", "tau_y"), SENSOR_TILT.sigma),
}
"""Standard deviations of the priors around zero of the coefficients that are not radial."""
PHYSICAL = ("cx", "cy", "p1", "p2", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
"""The numbers that cannot be just anything. The radial coefficients are a basis: together they may
be a good lens at any size.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LensOrder:
    """A lens with some number of coefficients, fitted jointly with the board's bend."""

    name: str
    """The number of OpenCV's coefficients, or the name of another lens model."""
    model: CameraModel
    joint: JointFit
    sees_corners: bool
    """True if the lens sees all but a few of the corners."""

    @property
    def is_possible(self) -> bool:
        """True if the fit converged to numbers within what lenses can be."""
        values, means, sigmas = self.joint.values, self.model.means, self.model.priors.sigmas
        is_end = self.joint.outcome is Outcome.CONVERGED and self.sees_corners
        return (
            is_end
            and not has_pole(*opencv_intrinsics(values))
            and all(
                abs(float(values[name] - means[name])) < MAX_SIGMAS * sigmas[name]
                for name in map(CAMERA.of, PHYSICAL)
                if name in values
            )
        )

    @property
    def least_gain(self) -> float:
        """The part of the error on held-out views by which this lens must be better than one with
        fewer coefficients. Radial coefficients must only do no harm: they continue the lens into
        the picture's corners, where few held-out corners are.
        """
        is_prism = self.name.isdigit() and int(self.name) >= PRISM_COUNT
        return MIN_PRISM_IMPROVEMENT if is_prism else 0.0

    def held_out_px(self, observations: Observations, folds: Split) -> float:
        """Return the root mean square error on views that are held out in turn."""
        errors = hold_out(self.model, observations, self.joint, folds)
        return float(np.sqrt(errors.by_view(errors.limit, errors.weight).mean()))


def choose_order(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    progress: Progress,
    *,
    with_fisheye: bool,
) -> tuple[str, dict[str, float], dict[int, OpenCVFit]]:
    """Return the number of OpenCV's coefficients that the views ask for, or the name of the
    fisheye; the error on held-out views, px, of each lens that was compared by it; and OpenCV's own
    fits, by their numbers of coefficients.

    The sensor's tilt is tried only if the thin prism is asked for, and if boards tilt: only then
    does a sensor's tilt differ from theirs. The same holds for the board's bend.

    Args:
        views: views with enough corners for a pose.
        board: the board of all views.
        size: width and height of the picture, px.
        progress: the place for the progress bar.
        with_fisheye: True to try a fisheye as well, if the lens is wide.

    Raises:
        NotEnoughDataError: no lens fits these views.
    """
    advance = progress.task("Lens coefficients", 2 * len(COEFFICIENTS))
    opencv: dict[int, OpenCVFit] = {}
    for count in COEFFICIENTS:
        if count <= RATIONAL_COUNT:
            earlier = next(reversed(opencv.values()), None)
            opencv[count] = refine_opencv(views, board, size, count, earlier)
            advance(len(opencv), "")
    tilted = spread_deg(opencv[RATIONAL_COUNT].poses, views, board) >= FLAT_DEG
    observations = Observations.of(views, board)
    folds = fold_split(pose_labels(views))
    held_out: dict[str, float] = {}

    def held_out_px(order: LensOrder) -> float:
        if order.name not in held_out:
            held_out[order.name] = order.held_out_px(observations, folds)
        return held_out[order.name]

    def is_better(order: LensOrder, simpler: LensOrder) -> bool:
        if not (order.is_possible and simpler.is_possible):
            return order.is_possible
        if order.joint.log_evidence < simpler.joint.log_evidence + MIN_LOG_ODDS:
            return False
        is_clear = order.joint.sigma < CLEAR_RATIO * simpler.joint.sigma
        return is_clear or held_out_px(order) < (1 - order.least_gain) * held_out_px(simpler)

    best: LensOrder | None = None
    for done, count in enumerate(COEFFICIENTS, 1 + len(COEFFICIENTS)):
        if count > PRISM_COUNT and not (tilted and best and best.name == str(PRISM_COUNT)):
            break
        if count in opencv:
            start = _start_from(opencv[count])
        elif best:
            start = best.joint.start, best.joint.poses
        with single_thread():
            order = _fit(str(count), start, size, board if tilted else None, observations)
            if best is None or is_better(order, best):
                best = order
        advance(done, f"{count} coefficients")
    assert best
    if with_fisheye and _field_angle(best, size) > WIDE:
        with suppress(NotEnoughDataError):
            fisheye = fit_lens(PLAIN, views, board, size)
            start = fisheye.joint.start, fisheye.joint.poses
            with single_thread():
                order = _fit(FISHEYE, start, size, board if tilted else None, observations)
                best = order if is_better(order, best) else best
    advance(2 * len(COEFFICIENTS), "")
    return best.name, held_out, opencv


def _field_angle(order: LensOrder, size: tuple[int, int]) -> float:
    """Return the angle in rad between the corner of the picture and the axis of a pinhole with this
    focal length.
    """
    return math.atan(math.hypot(*size) / 2 / float(order.joint.values[CAMERA.fx]))


def _start_from(solved: OpenCVFit) -> tuple[Start, Tensor]:
    """Return the start of a joint fit, and the (V, 6) poses of the boards."""
    numbers = [Number(float(value)) for value in solved.parameters]
    fx, fy, cx, cy = numbers[:4]
    _, values = pinhole_path(Intrinsics(fx, fy, cx, cy, tuple(numbers[4:])))
    return Start(values, solved.rms / 2**0.5, None), torch.from_numpy(solved.poses)


def _fit(
    name: str,
    start: tuple[Start, Tensor],
    size: tuple[int, int],
    board: Board | None,
    observations: Observations,
) -> LensOrder:
    """Fit a lens.

    Args:
        name: the number of OpenCV's coefficients, or the name of the fisheye.
        start: the start of the fit, and the (V, 6) poses of the boards.
        size: width and height of the picture, px.
        board: the board whose bend is estimated; None to take it as flat.
        observations: the views.
    """
    begin, poses = start
    model = _model(name, float(begin.values[CAMERA.fx]), size)
    if board and board.is_flat:
        model = model.with_effect(BoardShape(*board.half, DEGREES[0]))
    # What the simpler lens lacks starts at zero: the means of the priors belong together.
    lacking = {
        name: torch.zeros_like(model.means[name]) for name in model.means.keys() - begin.values
    }
    begin = replace(begin, values={**lacking, **begin.values})
    joint = model.fit(observations, poses, begin, ROUNDS)
    image = residuals(model.path, joint.values, observations, joint.poses).image
    seen = float(image.isfinite().all(-1).double().mean())
    return LensOrder(name, model, joint, seen > MIN_SEEN)


def _model(name: str, focal: float, size: tuple[int, int]) -> CameraModel:
    """Return the model of a camera whose lens is, in the mean of its prior, without distortion."""
    lens = OPENCV if name.isdigit() else name
    names = NAMES[lens][: int(name)] if name.isdigit() else NAMES[lens]
    intrinsics = Intrinsics(
        Number(focal),
        Number(focal),
        Number((size[0] - 1) / 2),
        Number((size[1] - 1) / 2),
        (Number(0.0, 1.0),) * len(names),
        model=lens,
    )
    path, means = pinhole_path(intrinsics)
    spreads = own_coefficient_sigmas(intrinsics) | SPREADS
    sigmas = {CAMERA.of(name): spreads[name] for name in names}
    sigmas |= dict.fromkeys(CAMERA.focal, FOCAL_SPREAD * focal)
    sigmas |= dict.fromkeys(CAMERA.centre, CENTRE_SPREAD * max(size))
    return CameraModel(path, prior_means(means), Priors(sigmas))
