"""The camera without its cover: intrinsics and lens by Zhang's method (cv2.calibrateCamera).

Source: Z. Zhang, A flexible new technique for camera calibration (2000), the paper's reference for its own intrinsics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.usable import with_poses
from calib.corners.view import Rejected, View, board_poses
from calib.errors import NotEnoughDataError
from calib.estimation.model_choice import simplest
from calib.estimation.robust import outlying
from calib.fitting.bare_covariance import intrinsics_covariance
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import COEFFICIENTS, Camera, Intrinsics
from calib.session.schema import Number

FEWEST_VIEWS = 4
LEAST_SPREAD_DEG = 5.0
"""Between the most different normals of the board."""
FOLDS = 4
WORTH = 0.02
"""Of the held-out error: more coefficients must leave less by more than this."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-9)

FLAGS = {
    0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    4: cv2.CALIB_FIX_K3,
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
    12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}


@dataclass(frozen=True, slots=True)
class BareFit:
    """A plain camera calibration."""

    intrinsics: Intrinsics
    """Each number with its standard deviation, and how they are correlated."""
    rms_px: float
    views: tuple[View, ...]
    rejected: tuple[Rejected, ...]
    held_out_px: dict[int, float]
    """By number of lens coefficients: the error on held-out views, where it was asked."""


@dataclass(frozen=True, slots=True)
class _Solved:
    camera: NDArray[np.float64]  # (3, 3)
    coefficients: NDArray[np.float64]  # (count,)
    per_view: NDArray[np.float64]  # (V,) px
    poses: NDArray[np.float64]  # (V, 6) rotation vector and translation of the board
    rms: float


def calibrate_bare(views: Sequence[View], board: Board, camera: Camera, progress: Progress) -> BareFit:
    """Intrinsics from views of a board, with the number of lens coefficients that `camera` asks for or that held-out views do.

    Raises:
        NotEnoughDataError: too few views are left.
    """
    usable, poseless = with_poses(views, board)
    kept, rejected = list(usable), list(poseless)
    _check_enough(kept)
    size = camera.width, camera.height
    held_out: dict[int, float] = {}
    count = camera.lens_coefficients
    if count is None:
        count, held_out = _choose_count(kept, board, size, progress)
    advance = progress.task("Intrinsics", 1)
    while True:
        solved = _solve(kept, board, size, count)
        bad = outlying(solved.per_view)
        if not bad.any():
            break
        rejected += [
            Rejected(view.name, f"its {error:.2f} px do not fit the {np.median(solved.per_view):.2f} px of the other views")
            for view, error, out in zip(kept, solved.per_view, bad, strict=True)
            if out
        ]
        kept = [view for view, out in zip(kept, bad, strict=True) if not out]
        _check_enough(kept)
    spread = _spread_deg(np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in solved.poses]))
    if spread < LEAST_SPREAD_DEG:
        raise NotEnoughDataError(
            f"All views without the cover show the board at the same angle, within {spread:.1f} degrees, and no focal length follows: "
            "take more pictures, with the board tilted in different directions."
        )
    advance(1, f"{solved.rms:.3f} px")
    return BareFit(_intrinsics(solved, kept, board), solved.rms, tuple(kept), tuple(rejected), held_out)


def _choose_count(views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress) -> tuple[int, dict[int, float]]:
    """The fewest coefficients within 2 % of the least error on views that the fit has not seen.

    The tilted sensor's fourteen take minutes, so they are tried only where the thin prism's twelve were worth having.
    """
    poses = board_poses(views)
    folds = min(FOLDS, int(poses.max() + 1) // 2)
    advance = progress.task("Lens coefficients", folds * len(COEFFICIENTS))
    previous: list[_Solved | None] = [None] * folds
    scores: dict[int, float] = {}
    for i, count in enumerate(COEFFICIENTS):
        if count == 14 and scores[12] > (1 - WORTH) * scores[8]:
            break
        per_view = np.empty(len(views))
        for fold in range(folds):
            out = poses % folds == fold
            rest = [view for view, held in zip(views, out, strict=True) if not held]
            solved = previous[fold] = _step(rest, board, size, count, previous[fold])
            for j in np.flatnonzero(out).tolist():
                per_view[j] = _held_out_rms(views[j], board, solved)
            advance(i * folds + fold + 1, f"{count} coefficients")
        # A few bad views would drown the rest: none counts for more than four times its model's median.
        per_view = np.nan_to_num(per_view, nan=np.inf)
        scores[count] = float(np.minimum(per_view, 4 * np.median(per_view)).mean())
    advance(folds * len(COEFFICIENTS), "")
    return simplest(scores, WORTH), scores


def _solve(views: Sequence[View], board: Board, size: tuple[int, int], count: int) -> _Solved:
    """Zhang's method, from few coefficients to many: started with many at once, it stops in poor places."""
    solved = None
    for fewer in COEFFICIENTS:
        if fewer < count:
            solved = _step(views, board, size, fewer, solved)
    return _step(views, board, size, count, solved)


def _step(views: Sequence[View], board: Board, size: tuple[int, int], count: int, start: _Solved | None) -> _Solved:
    points = np.column_stack([board.points(), np.zeros(board.count)]).astype(np.float32)
    objects = [points[view.seen] for view in views]
    pixels = [view.corners[view.seen].astype(np.float32) for view in views]
    coefficients = np.zeros(max(5, count))
    if start:
        coefficients[: len(start.coefficients)] = start.coefficients
    width, height = size
    camera = start.camera.copy() if start else np.array([[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1.0]])
    guess = cv2.CALIB_USE_INTRINSIC_GUESS if start else 0
    try:
        rms, found, bent, rotvecs, translations, _, _, per_view = cv2.calibrateCameraExtended(
            objects, pixels, size, camera, coefficients, flags=FLAGS[count] | guess, criteria=CRITERIA
        )
    except cv2.error as error:
        raise NotEnoughDataError(
            "No intrinsics fit these views: take pictures of the board tilted in different directions, "
            "and check board.columns and board.rows."
        ) from error
    lens = np.ravel(bent)[:count].astype(np.float64)
    return _Solved(
        found.astype(np.float64),
        lens,
        np.ravel(per_view).astype(np.float64),
        np.concatenate([np.squeeze(rotvecs, -1), np.squeeze(translations, -1)], 1),
        float(rms),
    )


def _held_out_rms(view: View, board: Board, solved: _Solved) -> float:
    points = np.column_stack([board.points(), np.zeros(board.count)])[view.seen]
    pixels = view.corners[view.seen]
    found, rotvec, translation = cv2.solvePnP(points, pixels, solved.camera, solved.coefficients)
    if not found:
        return float("nan")
    seen, _ = cv2.projectPoints(points, rotvec, translation, solved.camera, solved.coefficients)
    return float(np.sqrt(((seen.reshape(-1, 2) - pixels) ** 2).sum(-1).mean()))


def _intrinsics(solved: _Solved, views: Sequence[View], board: Board) -> Intrinsics:
    covariance = intrinsics_covariance(views, board, solved.camera, solved.coefficients, solved.poses)
    sigmas = np.sqrt(covariance.diagonal())
    correlation = covariance / np.outer(sigmas, sigmas)
    parameters = (solved.camera[0, 0], solved.camera[1, 1], solved.camera[0, 2], solved.camera[1, 2], *solved.coefficients)
    fx, fy, cx, cy, *lens = (Number(float(v), float(s)) for v, s in zip(parameters, sigmas, strict=True))
    return Intrinsics(fx, fy, cx, cy, tuple(lens), tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i))


def _spread_deg(normals: NDArray[np.float64]) -> float:
    """Degrees between the two most different of (V, 3) unit normals."""
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def _check_enough(views: Sequence[View]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise NotEnoughDataError(
            f"Intrinsics need {FEWEST_VIEWS} usable views without the cover and there are {len(views)}: "
            "take more pictures of the board, tilted in different directions."
        )
