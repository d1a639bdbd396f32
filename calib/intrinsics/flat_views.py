"""The focal length that views of hardly tilted boards tell: the best of several starts, and as sure
as the profile of the error over it.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.intrinsics.advice import TILT
from calib.intrinsics.covariance import freedom, intrinsics_covariance, widened_along
from calib.intrinsics.focal_profile import FARTHEST, profiled
from calib.intrinsics.opencv_lens import OpenCVFit, fit_opencv, step
from calib.session.board import Board

FLAT_DEG = 40.0
"""Between the most different normals of the board: below, the error over the focal length may have
several minima, and several starts are tried.
"""
STARTS = tuple(0.3 * 1.5**i for i in range(8))
"""Focal lengths over the picture's width, from a lens of 118 degrees to one of 10."""
LENS_OF_STARTS = 5
"""Lens coefficients with which the starts are compared, at most."""
REFITS = 5
"""How often a profile that finds a better minimum is followed there."""
WIDER = 1.1
"""A profile's standard deviation over the linearised one, from where on it counts: below, the error
is a parabola.
"""


def spread_deg(poses: NDArray[np.float64]) -> float:
    """Degrees between the two most different normals of boards at (V, 6) poses."""
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in poses])
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def best_of_starts(
    views: Sequence[View], board: Board, size: tuple[int, int], count: int
) -> OpenCVFit:
    """The fit of least error.

    Where the boards hardly tilt, or seem to, it is sought from several focal lengths.
    """
    solved = fit_opencv(views, board, size, count)
    if spread_deg(solved.poses) >= FLAT_DEG:
        return solved
    started = []
    for share in STARTS:
        with suppress(NotEnoughDataError):
            started.append(
                fit_opencv(views, board, size, min(count, LENS_OF_STARTS), share * size[0])
            )
    best = min(started, key=lambda one: one.rms, default=solved)
    return min(solved, step(views, board, size, count, best), key=lambda one: one.rms)


def with_profile(
    views: Sequence[View], board: Board, size: tuple[int, int], solved: OpenCVFit
) -> tuple[OpenCVFit, NDArray[np.float64]]:
    """The fit, if need be at the better minimum that its profile over the focal length finds, and
    its covariance: as wide as the profile.

    Raises:
        NotEnoughDataError: focal lengths that are far apart explain the views about as well.
    """
    count = len(solved.coefficients)

    def refit(times: float) -> OpenCVFit:
        try:
            return step(views, board, size, count, solved, times * solved.focal)
        except NotEnoughDataError:  # nothing fits there
            return replace(solved, rms=np.inf)

    for _ in range(REFITS):
        covariance = intrinsics_covariance(
            views, board, solved.camera, solved.coefficients, solved.poses
        )
        sigma = float(covariance[0, 0]) ** 0.5 / solved.focal
        interval, better = profiled(solved, refit, freedom(views, solved.poses, count), sigma)
        if better is solved:
            break
        solved = min(better, step(views, board, size, count, better), key=lambda one: one.rms)
    if not interval.closed:
        other = (
            f"{solved.focal / FARTHEST:.0f}"
            if not interval.low
            else f"{solved.focal * FARTHEST:.0f}"
        )
        raise NotEnoughDataError(
            f"The views without the cover are as well explained by a focal length of {other} px as"
            f" by one of {solved.focal:.0f} px: {TILT}."
        )
    if interval.sigma > WIDER * sigma:
        low, high = (refit(times).parameters for times in (interval.low, interval.high))
        along = (
            (high - low) / (high[0] - low[0])
            if high[0] > low[0]
            else covariance[0] / covariance[0, 0]
        )
        covariance = widened_along(along, interval.sigma * solved.focal, covariance)
    return solved, covariance
