"""The camera without its cover: its intrinsics and its lens, from views of a board."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View, pose_labels
from calib.errors import NotEnoughDataError
from calib.estimation.robust import outlier_mask
from calib.intrinsics.advice import TILT
from calib.intrinsics.flat_views import spread_deg, with_profile
from calib.intrinsics.lens_choice import choose_lens, fit_choice
from calib.intrinsics.opencv_lens import OpenCVFit
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics

FEWEST_VIEWS = 4
LEAST_SPREAD_DEG = 5.0
"""Between the most different normals of the board."""


@dataclass(frozen=True, slots=True)
class BareFit:
    """A plain camera calibration."""

    intrinsics: Intrinsics
    """Each number with its standard deviation, and how they are correlated."""
    rms_px: float
    views: tuple[View, ...]
    rejected: tuple[RejectedPicture, ...]
    held_out_px: dict[str, float]
    """By number of OpenCV's coefficients, or by the name of another lens model: the error on
    held-out views, where it was asked.
    """


def calibrate_bare(
    views: Sequence[View], board: Board, camera: Camera, progress: Progress
) -> BareFit:
    """Intrinsics from views of a board, with the lens model and number of coefficients that
    `camera` asks for or that held-out views do.

    Raises:
        NotEnoughDataError: too few views are left.
    """
    usable, poseless = split_usable_views(views, board)
    kept, rejected = list(usable), list(poseless)
    _check_enough(kept)
    size = camera.width, camera.height
    choice = choose_lens(kept, board, camera, progress)
    advance = progress.task("Intrinsics", 1)
    while True:
        solved = fit_choice(choice, kept, board, size)
        bad = outlier_mask(solved.per_view)
        if not bad.any():
            break
        rejected += [
            RejectedPicture(
                view.name,
                (
                    f"its {error:.2f} px do not fit the {np.nanmedian(solved.per_view):.2f} px of"
                    " the other views"
                    if np.isfinite(error)
                    else "the lens that the other views show does not see its corners"
                ),
            )
            for view, error, out in zip(kept, solved.per_view, bad, strict=True)
            if out
        ]
        kept = [view for view, out in zip(kept, bad, strict=True) if not out]
        _check_enough(kept)
    spread = spread_deg(solved.poses)
    if spread < LEAST_SPREAD_DEG:
        raise NotEnoughDataError(
            f"All views without the cover show the board at the same angle, within {spread:.1f}"
            f" degrees, and no focal length follows: {TILT}."
        )
    if isinstance(solved, OpenCVFit):
        solved, covariance = with_profile(kept, board, size, solved)
        intrinsics = solved.intrinsics(covariance)
    else:
        intrinsics = solved.intrinsics
    advance(1, f"{solved.rms:.3f} px")
    return BareFit(intrinsics, solved.rms, tuple(kept), tuple(rejected), choice.held_out)


def _check_enough(views: Sequence[View]) -> None:
    poses = len(set(pose_labels(views).tolist()))
    if poses < FEWEST_VIEWS:
        of = f" of {poses} poses of the board" if poses < len(views) else ""
        raise NotEnoughDataError(
            f"Intrinsics need {FEWEST_VIEWS} usable views without the cover, each of a pose of its"
            f" own, and there are {len(views)}{of}: take more pictures of the board, tilted in"
            " different directions."
        )
