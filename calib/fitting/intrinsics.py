"""The camera without its cover: intrinsics and lens by Zhang's method (cv2.calibrateCamera).

Source: Z. Zhang, A flexible new technique for camera calibration (2000), the paper's reference for its own intrinsics.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.usable import with_poses
from calib.corners.view import Rejected, View, board_poses
from calib.errors import NotEnoughDataError
from calib.estimation.model_choice import simplest
from calib.estimation.robust import outlying
from calib.fitting.bare_covariance import freedom, intrinsics_covariance, widened_along
from calib.fitting.focal_profile import FARTHEST, profiled
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import COEFFICIENTS, Camera, Intrinsics
from calib.session.schema import Number

FEWEST_VIEWS = 4
LEAST_SPREAD_DEG = 5.0
"""Between the most different normals of the board."""
FLAT_DEG = 40.0
"""The same, below which the error over the focal length may have several minima, and several starts are tried."""
STARTS = tuple(0.3 * 1.5**i for i in range(8))
"""Focal lengths over the picture's width, from a lens of 118 degrees to one of 10."""
LENS_OF_STARTS = 5
"""Lens coefficients with which the starts are compared, at most."""
REFITS = 5
"""How often a profile that finds a better minimum is followed there."""
WIDER = 1.1
"""A profile's standard deviation over the linearised one, from where on it counts: below, the error is a parabola."""
FOLDS = 4
WORTH = 0.02
"""Of the held-out error: more coefficients must leave less by more than this."""
TILT = "tilt the board by about 30 degrees, to each side and up and down, in 6 views"
"""What the views lack that tell no focal length."""
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

    @property
    def focal(self) -> float:
        """px, along x."""
        return float(self.camera[0, 0])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """(4 + count,) fx, fy, cx, cy and the coefficients."""
        return np.array([*self.camera[[0, 1, 0, 1], [0, 1, 2, 2]], *self.coefficients])


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
        solved = _least(kept, board, size, count)
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
    spread = _spread_deg(solved)
    if spread < LEAST_SPREAD_DEG:
        raise NotEnoughDataError(
            f"All views without the cover show the board at the same angle, within {spread:.1f} degrees, and no focal length follows: "
            f"{TILT}."
        )
    solved, covariance = _profiled(kept, board, size, solved)
    advance(1, f"{solved.rms:.3f} px")
    return BareFit(_intrinsics(solved, covariance), solved.rms, tuple(kept), tuple(rejected), held_out)


def _choose_count(views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress) -> tuple[int, dict[int, float]]:
    """The fewest coefficients within 2 % of the least error on views that the fit has not seen.

    The tilted sensor's fourteen take minutes, so they are tried only where the thin prism's twelve were worth having, and where boards
    tilt: a sensor's tilt is told from theirs by nothing else.
    """
    poses = board_poses(views)
    folds = min(FOLDS, int(poses.max() + 1) // 2)
    advance = progress.task("Lens coefficients", folds * len(COEFFICIENTS))
    previous: list[_Solved | None] = [None] * folds
    scores: dict[int, float] = {}
    for i, count in enumerate(COEFFICIENTS):
        if count == 14 and (scores[12] > (1 - WORTH) * scores[8] or any(one and _spread_deg(one) < FLAT_DEG for one in previous)):
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


def _least(views: Sequence[View], board: Board, size: tuple[int, int], count: int) -> _Solved:
    """The fit of least error. Where the boards hardly tilt, or seem to, it is sought from several focal lengths."""
    solved = _solve(views, board, size, count)
    if _spread_deg(solved) >= FLAT_DEG:
        return solved
    started = []
    for share in STARTS:
        with suppress(NotEnoughDataError):
            started.append(_solve(views, board, size, min(count, LENS_OF_STARTS), share * size[0]))
    best = min(started, key=lambda one: one.rms, default=solved)
    return min(solved, _step(views, board, size, count, best), key=lambda one: one.rms)


def _profiled(views: Sequence[View], board: Board, size: tuple[int, int], solved: _Solved) -> tuple[_Solved, NDArray[np.float64]]:
    """The fit, if need be at the better minimum that its profile over the focal length finds, and its covariance: as wide as the profile.

    Raises:
        NotEnoughDataError: focal lengths that are far apart explain the views about as well.
    """
    count = len(solved.coefficients)

    def refit(times: float) -> _Solved:
        try:
            return _step(views, board, size, count, solved, times * solved.focal)
        except NotEnoughDataError:  # nothing fits there
            return replace(solved, rms=np.inf)

    for _ in range(REFITS):
        covariance = intrinsics_covariance(views, board, solved.camera, solved.coefficients, solved.poses)
        sigma = float(covariance[0, 0]) ** 0.5 / solved.focal
        interval, better = profiled(solved, refit, freedom(views, solved.poses, count), sigma)
        if better is solved:
            break
        solved = min(better, _step(views, board, size, count, better), key=lambda one: one.rms)
    if not interval.closed:
        other = f"{solved.focal / FARTHEST:.0f}" if not interval.low else f"{solved.focal * FARTHEST:.0f}"
        raise NotEnoughDataError(
            f"The views without the cover are as well explained by a focal length of {other} px as by one of {solved.focal:.0f} px: {TILT}."
        )
    if interval.sigma > WIDER * sigma:
        low, high = (refit(times).parameters for times in (interval.low, interval.high))
        along = (high - low) / (high[0] - low[0]) if high[0] > low[0] else covariance[0] / covariance[0, 0]
        covariance = widened_along(along, interval.sigma * solved.focal, covariance)
    return solved, covariance


def _solve(views: Sequence[View], board: Board, size: tuple[int, int], count: int, focal: float | None = None) -> _Solved:
    """Zhang's method, from few coefficients to many: started with many at once, it stops in poor places."""
    solved = None
    for fewer in COEFFICIENTS:
        if fewer < count:
            solved = _step(views, board, size, fewer, solved, focal)
    return _step(views, board, size, count, solved, focal)


def _step(
    views: Sequence[View], board: Board, size: tuple[int, int], count: int, start: _Solved | None, focal: float | None = None
) -> _Solved:
    """The fit from a start, its focal length held if one is given (px)."""
    points = np.column_stack([board.points(), np.zeros(board.count)]).astype(np.float32)
    objects = [points[view.seen] for view in views]
    pixels = [view.corners[view.seen].astype(np.float32) for view in views]
    coefficients = np.zeros(max(5, count))
    if start:
        coefficients[: len(start.coefficients)] = start.coefficients
    width, height = size
    camera = start.camera.copy() if start else np.array([[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1.0]])
    camera[:2, 2] = np.clip(camera[:2, 2], 1, np.array(size) - 2)  # OpenCV starts from nowhere else
    guess = cv2.CALIB_USE_INTRINSIC_GUESS if start or focal else 0
    if focal:
        camera[:2, :2] *= focal / camera[0, 0]
        guess |= cv2.CALIB_FIX_FOCAL_LENGTH
    try:
        rms, found, bent, rotvecs, translations, _, _, per_view = cv2.calibrateCameraExtended(
            objects, pixels, size, camera, coefficients, flags=FLAGS[count] | guess, criteria=CRITERIA
        )
    except cv2.error as error:
        raise NotEnoughDataError(f"No intrinsics fit these views: check board.columns and board.rows, and {TILT}.") from error
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
    try:
        found, rotvec, translation = cv2.solvePnP(points, pixels, solved.camera, solved.coefficients)
    except cv2.error:  # corners from which no pose follows
        found = False
    if not found:
        return float("nan")
    seen, _ = cv2.projectPoints(points, rotvec, translation, solved.camera, solved.coefficients)
    return float(np.sqrt(((seen.reshape(-1, 2) - pixels) ** 2).sum(-1).mean()))


def _intrinsics(solved: _Solved, covariance: NDArray[np.float64]) -> Intrinsics:
    sigmas = np.sqrt(covariance.diagonal())
    correlation = covariance / np.outer(sigmas, sigmas)
    fx, fy, cx, cy, *lens = (Number(float(v), float(s)) for v, s in zip(solved.parameters, sigmas, strict=True))
    return Intrinsics(fx, fy, cx, cy, tuple(lens), tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i))


def _spread_deg(solved: _Solved) -> float:
    """Degrees between the two most different normals of the board."""
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in solved.poses])
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def _check_enough(views: Sequence[View]) -> None:
    poses = len(set(board_poses(views).tolist()))
    if poses < FEWEST_VIEWS:
        of = f" of {poses} poses of the board" if poses < len(views) else ""
        raise NotEnoughDataError(
            f"Intrinsics need {FEWEST_VIEWS} usable views without the cover, each of a pose of its own, and there are {len(views)}{of}: "
            "take more pictures of the board, tilted in different directions."
        )
