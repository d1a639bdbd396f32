"""Calibrate the camera without its cover: its intrinsics and its lens, from views of a board."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import MISFIT, RejectedPicture, View, describe_most, pose_labels
from calib.errors import NotEnoughDataError
from calib.estimation.robust import outlier_mask
from calib.intrinsics.advice import NO_FIT_OF_POINTS, TILT, NoFitError
from calib.intrinsics.flat_views import refine_with_profile
from calib.intrinsics.lens_choice import choose_lens, fit_choice
from calib.intrinsics.opencv_fit import OpenCVFit
from calib.intrinsics.spatial_target import has_depth, split_views, spread_deg
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics

MIN_BARE_POSES = 4
"""Poses of the board that intrinsics need."""
MAX_ERROR = 0.1
"""The largest error of a fit, relative to the picture's longer side. Corners in random places leave
more.
"""
MIN_SPREAD_DEG = 5.0
"""Least angle between the two most different normals of the board."""


@dataclass(frozen=True, slots=True)
class BareFit:
    """A calibration of the camera without a cover."""

    intrinsics: Intrinsics
    """The intrinsics with standard deviations and correlations."""
    rms_px: float
    views: tuple[View, ...]
    rejected: tuple[RejectedPicture, ...]
    held_out_px: dict[str, float]
    """Error on held-out views by the number of OpenCV's coefficients or the name of another lens
    model; empty if the lens was not chosen by it.
    """
    final: bool = False
    """True if a joint fit must not estimate the intrinsics again: the views hardly determine the
    focal length, or the lens has a spline, which a joint fit with a cover holds.
    """


def calibrate_bare(
    views: Sequence[View], board: Board, camera: Camera, progress: Progress
) -> BareFit:
    """Return the intrinsics that fit views of a board, with the lens model and the number of
    coefficients that `camera` states, or that held-out views choose.

    Raises:
        NotEnoughDataError: too few views are usable, or they do not determine the focal length.
    """
    try:
        return _calibrate(views, board, camera, progress)
    except NoFitError as error:
        if board.has_grid:
            raise
        raise NotEnoughDataError(NO_FIT_OF_POINTS) from error


def _calibrate(views: Sequence[View], board: Board, camera: Camera, progress: Progress) -> BareFit:
    """Return the intrinsics of `calibrate_bare`."""
    usable, poseless = split_usable_views(views, board)
    inliers = list(usable)
    rejected = list(poseless)
    _check_enough(inliers, rejected, board)
    size = camera.width, camera.height
    parts = split_views(inliers)
    choice = choose_lens(parts, board, camera, progress)
    if len(parts) > len(inliers):
        choice = replace(choice, solved={})
    advance = progress.task("Intrinsics", 1)
    while True:
        solved = fit_choice(choice, inliers, board, size)
        outlying = outlier_mask(solved.per_view)
        if not outlying.any():
            break
        rejected += [
            RejectedPicture(
                view.name,
                (
                    f"its {error:.2g} {MISFIT} {np.nanmedian(solved.per_view):.2g} px of"
                    " the other views"
                    if np.isfinite(error)
                    else "the lens that the other views show does not see its corners"
                ),
            )
            for view, error, is_outlier in zip(inliers, solved.per_view, outlying, strict=True)
            if is_outlier
        ]
        inliers = [view for view, out in zip(inliers, outlying, strict=True) if not out]
        choice = replace(choice, solved={})
        _check_enough(inliers, rejected, board)
    if solved.rms > MAX_ERROR * max(size):
        raise NoFitError()
    spread = spread_deg(solved.poses, inliers, board)
    if spread < MIN_SPREAD_DEG:
        raise NotEnoughDataError(
            f"All views without the cover show the board at the same angle, within {spread:.1f}"
            f" degrees, and no focal length follows: {TILT}."
        )
    skewed = False
    if isinstance(solved, OpenCVFit):
        solved, covariance, skewed = refine_with_profile(inliers, board, size, solved)
        intrinsics = solved.intrinsics(covariance)
    else:
        intrinsics = solved.intrinsics
    final = skewed or intrinsics.spline is not None
    if not final:
        from calib.intrinsics.joint_intrinsics import fit_with_bend

        intrinsics = fit_with_bend(intrinsics, inliers, board, solved.poses)
    advance(1, f"{solved.rms:.3f} px")
    return BareFit(
        intrinsics, solved.rms, tuple(inliers), tuple(rejected), choice.held_out, final=final
    )


def _check_enough(views: Sequence[View], rejected: Sequence[RejectedPicture], board: Board) -> None:
    poses = len(set(pose_labels(views).tolist()))
    if poses < MIN_BARE_POSES and not any(has_depth(view, board) for view in views):
        pose_count = f" of {poses} poses of the board" if poses < len(views) else ""
        raise NotEnoughDataError(
            f"Intrinsics need {MIN_BARE_POSES} usable views without the cover, each of a pose of"
            f" its own, and there are {len(views)}{pose_count}{describe_most(rejected)}: take more"
            f" {board.views_words}, tilted in different directions."
        )
