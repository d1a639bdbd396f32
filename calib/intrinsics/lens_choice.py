"""Which lens a camera has: as it is stated, or as held-out views say."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.model_choice import simplest_model
from calib.intrinsics.advice import NO_FIT
from calib.intrinsics.flat_views import FLAT_DEG, best_of_starts, spread_deg
from calib.intrinsics.held_out_views import folds_of, held_out_errors, summed
from calib.intrinsics.opencv_lens import OpenCVFit, fit_opencv, step
from calib.intrinsics.ray_lens import PLAIN, SPLINES, RayLens
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.lens import COEFFICIENTS, FISHEYE, OPENCV, SPLINED

if TYPE_CHECKING:
    from calib.intrinsics.ray_lens_fit import LensFit

WORTH = 0.02
"""Of the held-out error: more coefficients must leave less by more than this."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What is to be fitted."""

    count: int | None = None
    """Of OpenCV's coefficients."""
    by_rays: RayLens | None = None
    """Another lens than OpenCV's."""
    held_out: dict[str, float] = field(default_factory=dict)
    """px, the errors that it was chosen by."""


def choose_lens(views: Sequence[View], board: Board, camera: Camera, progress: Progress) -> Choice:
    """The lens model, OpenCV's number of coefficients or a spline's of columns: as stated or by
    held-out views.
    """
    model, count = camera.lens or OPENCV, camera.lens_coefficients
    if model == FISHEYE:
        return Choice(by_rays=PLAIN)
    size = camera.width, camera.height
    if model == SPLINED:
        scores = _by_rays(SPLINES, views, board, size, progress)
        if not scores:
            raise NotEnoughDataError(NO_FIT)
        return Choice(None, simplest_model(scores, WORTH), _named(scores))
    held_out: dict[str, float] = {}
    if count is None:
        count, by_count = _choose_count(views, board, size, progress)
        held_out = {str(tried): error for tried, error in by_count.items()}
    if model == OPENCV:
        return Choice(count, None, held_out)
    if str(count) not in held_out:
        held_out[str(count)] = summed(
            held_out_errors(views, board, lambda rest, _: fit_opencv(rest, board, size, count))
        )
    scores = _by_rays((PLAIN, *SPLINES), views, board, size, progress)
    least = held_out[str(count)]
    held_out |= _named(scores)
    better = {lens: error for lens, error in scores.items() if error < (1 - WORTH) * least}
    return Choice(count, simplest_model(better, WORTH) if better else None, held_out)


def fit_choice(
    choice: Choice, views: Sequence[View], board: Board, size: tuple[int, int]
) -> "OpenCVFit | LensFit":
    if not choice.by_rays:
        return best_of_starts(views, board, size, choice.count or 0)
    from calib.intrinsics.ray_lens_fit import fit_lens

    return fit_lens(choice.by_rays, views, board, size)


def _by_rays(
    lenses: Sequence[RayLens],
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    progress: Progress,
) -> dict[RayLens, float]:
    """The error on held-out views of each lens, from the simplest on, up to the first spline that
    is worse than what is coarser; none of a lens that sees no such views.
    """
    from calib.intrinsics.ray_lens_fit import fit_lens

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


def _choose_count(
    views: Sequence[View], board: Board, size: tuple[int, int], progress: Progress
) -> tuple[int, dict[int, float]]:
    """The fewest coefficients within 2 % of the least error on views that the fit has not seen.

    The tilted sensor's fourteen take minutes, so they are tried only where the thin prism's twelve
    were worth having, and where boards
    tilt: a sensor's tilt is told from theirs by nothing else.
    """
    folds = folds_of(views)
    advance = progress.task("Lens coefficients", folds * len(COEFFICIENTS))
    previous: list[OpenCVFit | None] = [None] * folds
    scores: dict[int, float] = {}
    for i, count in enumerate(COEFFICIENTS):
        if count == 14 and (
            scores[12] > (1 - WORTH) * scores[8]
            or any(one and spread_deg(one.poses) < FLAT_DEG for one in previous)
        ):
            break

        def further(rest: Sequence[View], fold: int, i: int = i, count: int = count) -> OpenCVFit:
            solved = previous[fold] = step(rest, board, size, count, previous[fold])
            advance(i * folds + fold + 1, f"{count} coefficients")
            return solved

        scores[count] = summed(held_out_errors(views, board, further))
    advance(folds * len(COEFFICIENTS), "")
    return simplest_model(scores, WORTH), scores
