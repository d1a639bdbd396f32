"""The number of OpenCV's lens coefficients that the views ask for.

Each number is fitted jointly with the poses and the board's bend, because a bent board that is
taken as flat asks for coefficients that the lens does not have. A further coefficient has to make
the corners more probable, lower the error on held-out views, and stay within what lenses can be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from calib.corners.view import View, pose_labels
from calib.effects.board_shape import DEGREES, BoardShape
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit, Start
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.priors import Priors
from calib.inference.cross_validation import Split, fold_split, hold_out
from calib.intrinsics.flat_views import FLAT_DEG, spread_deg
from calib.intrinsics.opencv_lens import PRISM_COUNT, OpenCVFit, refine_opencv
from calib.optics.build import pinhole_path
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import COEFFICIENTS, NAMES, OPENCV
from calib.session.schema import Number
from calib.session.tolerances import OWN_COEFFICIENT, SENSOR_TILT, TANGENTIAL, THIN_PRISM
from calib.threads import single_thread

RATIONAL_COUNT = 8
"""The most coefficients with which OpenCV's own fit gives the start: with more, it takes minutes.
"""
MIN_LENS_IMPROVEMENT = 0.02
"""Fraction by which more coefficients must lower the held-out error."""
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
SPREADS = {
    **dict.fromkeys(NAMES[OPENCV], OWN_COEFFICIENT.sigma),
    **dict.fromkeys(("p1", "p2"), TANGENTIAL.sigma),
    **dict.fromkeys(("s1", "s2", "s3", "s4"), THIN_PRISM.sigma),
    **dict.fromkeys(("tau_x", "tau_y"), SENSOR_TILT.sigma),
}
"""Standard deviations of the priors of the coefficients around zero."""
PHYSICAL = ("cx", "cy", "p1", "p2", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
"""The numbers that cannot be just anything. The radial coefficients are a basis: together they may
be a good lens at any size.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LensOrder:
    """A lens with some number of coefficients, fitted jointly with the board's bend."""

    count: int
    model: CameraModel
    joint: JointFit

    @property
    def is_possible(self) -> bool:
        """True if the fit converged to numbers within what lenses can be."""
        values, means, sigmas = self.joint.values, self.model.means, self.model.priors.sigmas
        return self.joint.outcome is Outcome.CONVERGED and all(
            abs(float(values[name] - means[name])) < MAX_SIGMAS * sigmas[name]
            for name in (f"camera.{name}" for name in PHYSICAL)
            if name in values
        )

    def held_out_px(self, observations: Observations, folds: Split) -> float:
        """Return the root mean square error on views that are held out in turn."""
        errors = hold_out(self.model, observations, self.joint, folds)
        return float(np.sqrt(errors.by_view(errors.limit, errors.weight).mean()))


def choose_order(
    views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress
) -> tuple[int, dict[int, float]]:
    """Return the number of coefficients that the views ask for, and the error on held-out views for
    each number that was compared by it, px.

    The sensor's tilt is tried only if the thin prism is asked for, and if boards tilt: only then
    does a sensor's tilt differ from theirs. The same holds for the board's bend.

    Args:
        views: views with enough corners for a pose.
        board: the board of all views.
        size: width and height of the picture, px.
        progress: the place for the progress bar.

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
    tilted = spread_deg(opencv[RATIONAL_COUNT].poses) >= FLAT_DEG
    observations = Observations.of(views, board)
    folds = fold_split(pose_labels(views))
    held_out: dict[int, float] = {}

    def held_out_px(order: LensOrder) -> float:
        if order.count not in held_out:
            held_out[order.count] = order.held_out_px(observations, folds)
        return held_out[order.count]

    def is_better(order: LensOrder, simpler: LensOrder) -> bool:
        if not (order.is_possible and simpler.is_possible):
            return order.is_possible
        if order.joint.log_evidence < simpler.joint.log_evidence + MIN_LOG_ODDS:
            return False
        return order.joint.sigma < CLEAR_RATIO * simpler.joint.sigma or held_out_px(order) < (
            1 - MIN_LENS_IMPROVEMENT
        ) * held_out_px(simpler)

    best: LensOrder | None = None
    for done, count in enumerate(COEFFICIENTS, 1 + len(COEFFICIENTS)):
        if count > PRISM_COUNT and not (tilted and best and best.count == PRISM_COUNT):
            break
        if count in opencv:
            start = _start_from(opencv[count])
        elif best:
            start = best.joint.start, best.joint.poses
        with single_thread():
            order = _fit(count, start, size, board if tilted else None, observations)
            if best is None or is_better(order, best):
                best = order
        advance(done, f"{count} coefficients")
    advance(2 * len(COEFFICIENTS), "")
    assert best
    return best.count, dict(sorted(held_out.items()))


def _start_from(solved: OpenCVFit) -> tuple[Start, Tensor]:
    """Return the start of a joint fit, and the (V, 6) poses of the boards."""
    numbers = [Number(float(value)) for value in solved.parameters]
    fx, fy, cx, cy = numbers[:4]
    _, values = pinhole_path(Intrinsics(fx, fy, cx, cy, tuple(numbers[4:])))
    return Start(values, solved.rms / 2**0.5, None), torch.from_numpy(solved.poses)


def _fit(
    count: int,
    start: tuple[Start, Tensor],
    size: tuple[int, int],
    board: Board | None,
    observations: Observations,
) -> LensOrder:
    """Fit a lens with `count` coefficients.

    Args:
        count: the number of coefficients.
        start: the start of the fit, and the (V, 6) poses of the boards.
        size: width and height of the picture, px.
        board: the board whose bend is estimated; None to take it as flat.
        observations: the views.
    """
    begin, poses = start
    model = _model(count, float(begin.values["camera.fx"]), size)
    if board:
        model = model.with_effect(BoardShape(*board.half, DEGREES[0]))
    return LensOrder(count, model, model.fit(observations, poses, begin, ROUNDS))


def _model(count: int, focal: float, size: tuple[int, int]) -> CameraModel:
    """Return the model of a camera whose lens has `count` coefficients around zero."""
    path, means = pinhole_path(
        Intrinsics(
            Number(focal),
            Number(focal),
            Number((size[0] - 1) / 2),
            Number((size[1] - 1) / 2),
            (Number(0.0, 1.0),) * count,
        )
    )
    sigmas = {f"camera.{name}": SPREADS[name] for name in NAMES[OPENCV][:count]}
    sigmas |= dict.fromkeys(("camera.fx", "camera.fy"), FOCAL_SPREAD * focal)
    sigmas |= dict.fromkeys(("camera.cx", "camera.cy"), CENTRE_SPREAD * max(size))
    return CameraModel(path, means, Priors(sigmas))
