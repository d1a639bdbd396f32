"""The focal length from views of hardly tilted boards: the best of several starts, with the
uncertainty of its profile likelihood.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.intrinsics.advice import TILT
from calib.intrinsics.covariance import freedom, intrinsics_covariance, widen_along
from calib.intrinsics.focal_profile import MAX_RATIO, profile_focal_length
from calib.intrinsics.opencv_fit import OpenCVFit
from calib.intrinsics.opencv_lens import fit_opencv, refine_opencv
from calib.intrinsics.spatial_target import spread_deg
from calib.session.board import Board

FLAT_DEG = 40.0
"""Angle between the two most different normals of the board. Below it, the error over the focal
length may have several minima, and several starts are tried.
"""
STARTS = tuple(0.3 * 1.5**i for i in range(8))
"""Focal lengths over the picture's width, from a lens of 118 degrees to one of 10."""
MAX_START_COEFFICIENTS = 5
"""Lens coefficients with which the starts are compared, at most."""
MAX_REFITS = 5
"""Times that the fit moves to a better minimum which the profile finds."""
MUCH_WIDENING = 2.0
"""The same ratio from which the focal length is hardly determined, and a joint fit, which takes the
error for a parabola, must not estimate it again.
"""
MIN_WIDENING = 1.1
"""Ratio of the profile's standard deviation to the linearised one from which the profile is used:
below it, the error is a parabola.
"""


def best_of_starts(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    count: int,
    earlier: Mapping[int, OpenCVFit] | None = None,
) -> OpenCVFit:
    """Return the fit of least error.

    If the fitted boards hardly tilt, the fit is repeated from several focal lengths. `earlier` are
    fits of the same views, by their numbers of coefficients.
    """
    solved = fit_opencv(views, board, size, count, earlier=earlier)
    if spread_deg(solved.poses, views, board) >= FLAT_DEG:
        return solved
    candidates = []
    for ratio in STARTS:
        with suppress(NotEnoughDataError):
            candidates.append(
                fit_opencv(views, board, size, min(count, MAX_START_COEFFICIENTS), ratio * size[0])
            )
    best = min(candidates, key=lambda fit: fit.rms, default=solved)
    return min(solved, refine_opencv(views, board, size, count, best), key=lambda fit: fit.rms)


def refine_with_profile(
    views: Sequence[View], board: Board, size: tuple[int, int], solved: OpenCVFit
) -> tuple[OpenCVFit, NDArray[np.float64], bool]:
    """Return the fit, moved to a better minimum if its profile over the focal length finds one; its
    covariance, widened to the profile's interval; and True if it was widened much.

    Raises:
        NotEnoughDataError: focal lengths that are far apart explain the views about as well.
    """
    count = len(solved.coefficients)

    def refit(times: float) -> OpenCVFit:
        try:
            return refine_opencv(views, board, size, count, solved, times * solved.focal)
        except NotEnoughDataError:  # nothing fits there
            return replace(solved, rms=np.inf)

    for _ in range(MAX_REFITS):
        covariance = intrinsics_covariance(
            views, board, solved.camera, solved.coefficients, solved.poses
        )
        sigma = float(covariance[0, 0]) ** 0.5 / solved.focal
        interval, better = profile_focal_length(
            solved, refit, freedom(views, solved.poses, count), sigma
        )
        if better is solved:
            break
        refined = refine_opencv(views, board, size, count, better)
        solved = min(better, refined, key=lambda fit: fit.rms)
    if not interval.closed:
        focal = (
            f"{solved.focal / MAX_RATIO:.0f}"
            if not interval.low
            else f"{solved.focal * MAX_RATIO:.0f}"
        )
        raise NotEnoughDataError(
            f"The views without the cover are as well explained by a focal length of {focal} px as"
            f" by one of {solved.focal:.0f} px: {TILT}."
        )
    if interval.sigma > MIN_WIDENING * sigma:
        low = refit(interval.low).parameters
        high = refit(interval.high).parameters
        direction = (
            (high - low) / (high[0] - low[0])
            if high[0] > low[0]
            else covariance[0] / covariance[0, 0]
        )
        covariance = widen_along(direction, interval.sigma * solved.focal, covariance)
    return solved, covariance, interval.sigma > MUCH_WIDENING * sigma
