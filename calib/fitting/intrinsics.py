"""The camera without its cover: intrinsics and lens, OpenCV's by Zhang's method (cv2.calibrateCamera), wider ones by their rays.

Source: Z. Zhang, A flexible new technique for camera calibration (2000), the paper's reference for its own intrinsics.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.usable import with_poses
from calib.corners.view import Rejected, View
from calib.errors import NotEnoughDataError
from calib.estimation.model_choice import simplest
from calib.estimation.robust import outlying
from calib.fitting.bare_covariance import intrinsics_covariance
from calib.fitting.held_out_views import folds_of, held_out_errors, summed
from calib.fitting.ray_lens import NO_FIT, PLAIN, SPLINES, RayLens
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.lens import COEFFICIENTS, FISHEYE, OPENCV, SPLINED
from calib.session.schema import Number

if TYPE_CHECKING:
    from calib.fitting.lens_by_rays import LensFit

FEWEST_VIEWS = 4
LEAST_SPREAD_DEG = 5.0
"""Between the most different normals of the board."""
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
    held_out_px: dict[str, float]
    """By number of OpenCV's coefficients, or by the name of another lens model: the error on held-out views, where it was asked."""


@dataclass(frozen=True, slots=True)
class _Solved:
    camera: NDArray[np.float64]  # (3, 3)
    coefficients: NDArray[np.float64]  # (count,)
    per_view: NDArray[np.float64]  # (V,) px
    poses: NDArray[np.float64]  # (V, 6) rotation vector and translation of the board
    rms: float

    def intrinsics(self, views: Sequence[View], board: Board) -> Intrinsics:
        """From the views that were fitted."""
        covariance = intrinsics_covariance(views, board, self.camera, self.coefficients, self.poses)
        sigmas = np.sqrt(covariance.diagonal())
        correlation = covariance / np.outer(sigmas, sigmas)
        parameters = (self.camera[0, 0], self.camera[1, 1], self.camera[0, 2], self.camera[1, 2], *self.coefficients)
        fx, fy, cx, cy, *lens = (Number(float(v), float(s)) for v, s in zip(parameters, sigmas, strict=True))
        return Intrinsics(fx, fy, cx, cy, tuple(lens), tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i))

    def errors(self, views: Sequence[View], board: Board) -> NDArray[np.float64]:
        """(V,) px, the root mean square of views that it was not fitted to, their poses fitted; NaN for one that has none."""
        return np.array([self._error(view, board) for view in views])

    def _error(self, view: View, board: Board) -> float:
        points = np.column_stack([board.points(), np.zeros(board.count)])[view.seen]
        pixels = view.corners[view.seen]
        found, rotvec, translation = cv2.solvePnP(points, pixels, self.camera, self.coefficients)
        if not found:
            return float("nan")
        seen, _ = cv2.projectPoints(points, rotvec, translation, self.camera, self.coefficients)
        return float(np.sqrt(((seen.reshape(-1, 2) - pixels) ** 2).sum(-1).mean()))


def calibrate_bare(views: Sequence[View], board: Board, camera: Camera, progress: Progress) -> BareFit:
    """Intrinsics from views of a board, with the lens model and number of coefficients that `camera` asks for or that held-out views do.

    Raises:
        NotEnoughDataError: too few views are left.
    """
    usable, poseless = with_poses(views, board)
    kept, rejected = list(usable), list(poseless)
    _check_enough(kept)
    size = camera.width, camera.height
    choice = _choose_lens(kept, board, camera, progress)
    advance = progress.task("Intrinsics", 1)
    while True:
        solved = _fit(choice, kept, board, size)
        bad = outlying(solved.per_view)
        if not bad.any():
            break
        rejected += [
            Rejected(
                view.name,
                f"its {error:.2f} px do not fit the {np.nanmedian(solved.per_view):.2f} px of the other views"
                if np.isfinite(error)
                else "the lens that the other views show does not see its corners",
            )
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
    return BareFit(solved.intrinsics(kept, board), solved.rms, tuple(kept), tuple(rejected), choice.held_out)


@dataclass(frozen=True, slots=True)
class _Choice:
    """What is to be fitted."""

    count: int | None = None
    """Of OpenCV's coefficients."""
    by_rays: RayLens | None = None
    """Another lens than OpenCV's."""
    held_out: dict[str, float] = field(default_factory=dict)
    """px, the errors that it was chosen by."""


def _choose_lens(views: Sequence[View], board: Board, camera: Camera, progress: Progress) -> _Choice:
    """The lens model, OpenCV's number of coefficients or a spline's of columns: as stated or by held-out views."""
    model, count = camera.lens or OPENCV, camera.lens_coefficients
    if model == FISHEYE:
        return _Choice(by_rays=PLAIN)
    size = camera.width, camera.height
    if model == SPLINED:
        scores = _by_rays(SPLINES, views, board, size, progress)
        if not scores:
            raise NotEnoughDataError(NO_FIT)
        return _Choice(None, simplest(scores, WORTH), _named(scores))
    held_out: dict[str, float] = {}
    if count is None:
        count, by_count = _choose_count(views, board, size, progress)
        held_out = {str(tried): error for tried, error in by_count.items()}
    if model == OPENCV:
        return _Choice(count, None, held_out)
    if str(count) not in held_out:
        held_out[str(count)] = summed(held_out_errors(views, board, lambda rest, _: fit_opencv(rest, board, size, count)))
    scores = _by_rays((PLAIN, *SPLINES), views, board, size, progress)
    least = held_out[str(count)]
    held_out |= _named(scores)
    better = {lens: error for lens, error in scores.items() if error < (1 - WORTH) * least}
    return _Choice(count, simplest(better, WORTH) if better else None, held_out)


def _fit(choice: _Choice, views: Sequence[View], board: Board, size: tuple[int, int]) -> "_Solved | LensFit":
    if not choice.by_rays:
        return fit_opencv(views, board, size, choice.count or 0)
    from calib.fitting.lens_by_rays import fit_lens

    return fit_lens(choice.by_rays, views, board, size)


def _by_rays(
    lenses: Sequence[RayLens], views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress
) -> dict[RayLens, float]:
    """The error on held-out views of each lens, from the simplest on, up to the first spline that is worse than what is coarser; none of a
    lens that sees no such views."""
    from calib.fitting.lens_by_rays import fit_lens

    advance = progress.task("Lens models", len(lenses))
    plain: dict[int, LensFit] = {}
    scores: dict[RayLens, float] = {}

    def further(lens: RayLens, rest: Sequence[View], fold: int) -> "LensFit":
        if fold not in plain:
            plain[fold] = fit_lens(PLAIN, rest, board, size)
        return plain[fold] if lens == PLAIN else fit_lens(lens, rest, board, size, plain[fold])

    for done, lens in enumerate(lenses, 1):
        with suppress(NotEnoughDataError):
            scores[lens] = summed(held_out_errors(views, board, partial(further, lens)))
        advance(done, str(lens))
        if lens.columns and scores.get(lens, np.inf) > min(scores.values(), default=np.inf):
            break  # finer still is worse still
    return scores


def _named(scores: dict[RayLens, float]) -> dict[str, float]:
    return {str(lens): error for lens, error in scores.items()}


def _choose_count(views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress) -> tuple[int, dict[int, float]]:
    """The fewest coefficients within 2 % of the least error on views that the fit has not seen.

    The tilted sensor's fourteen take minutes, so they are tried only where the thin prism's twelve were worth having.
    """
    folds = folds_of(views)
    advance = progress.task("Lens coefficients", folds * len(COEFFICIENTS))
    previous: list[_Solved | None] = [None] * folds
    scores: dict[int, float] = {}
    for i, count in enumerate(COEFFICIENTS):
        if count == 14 and scores[12] > (1 - WORTH) * scores[8]:
            break

        def further(rest: Sequence[View], fold: int, i: int = i, count: int = count) -> _Solved:
            solved = previous[fold] = _step(rest, board, size, count, previous[fold])
            advance(i * folds + fold + 1, f"{count} coefficients")
            return solved

        scores[count] = summed(held_out_errors(views, board, further))
    advance(folds * len(COEFFICIENTS), "")
    return simplest(scores, WORTH), scores


def fit_opencv(views: Sequence[View], board: Board, size: tuple[int, int], count: int) -> _Solved:
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
        raise NotEnoughDataError(NO_FIT) from error
    lens = np.ravel(bent)[:count].astype(np.float64)
    return _Solved(
        found.astype(np.float64),
        lens,
        np.ravel(per_view).astype(np.float64),
        np.concatenate([np.squeeze(rotvecs, -1), np.squeeze(translations, -1)], 1),
        float(rms),
    )


def _spread_deg(normals: NDArray[np.float64]) -> float:
    """Degrees between the two most different of (V, 3) unit normals."""
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def _check_enough(views: Sequence[View]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise NotEnoughDataError(
            f"Intrinsics need {FEWEST_VIEWS} usable views without the cover and there are {len(views)}: "
            "take more pictures of the board, tilted in different directions."
        )
