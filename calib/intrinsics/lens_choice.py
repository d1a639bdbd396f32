"""Choose the lens model of a camera: the stated one, or the best on held-out views."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.model_choice import simplest_model
from calib.intrinsics.advice import NoFitError
from calib.intrinsics.flat_views import best_of_starts
from calib.intrinsics.held_out_views import MIN_LENS_IMPROVEMENT, clipped_mean, held_out_errors
from calib.intrinsics.opencv_fit import OpenCVFit
from calib.intrinsics.opencv_lens import fit_opencv
from calib.intrinsics.ray_lens import PLAIN, SPLINES, RayLens
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.lens import FISHEYE, OPENCV, SPLINED

if TYPE_CHECKING:
    from calib.intrinsics.ray_lens_fit import LensFit


@dataclass(frozen=True, slots=True)
class LensChoice:
    """The lens model to fit."""

    count: int | None = None
    """Number of OpenCV's coefficients; None if OpenCV's lens was not considered."""
    ray_lens: RayLens | None = None
    """A lens that is not OpenCV's; None for OpenCV's."""
    held_out: dict[str, float] = field(default_factory=dict)
    """Errors on held-out views, px, that the choice compared."""
    solved: dict[int, OpenCVFit] = field(default_factory=dict)
    """OpenCV's fits of all views, by their numbers of coefficients."""


def choose_lens(
    views: Sequence[View], board: Board, camera: Camera, progress: Progress
) -> LensChoice:
    """Return the lens model with the number of OpenCV's coefficients or of a spline's columns: the
    stated ones, or the best on held-out views.
    """
    model, count = camera.lens or OPENCV, camera.lens_coefficients
    if model == FISHEYE:
        return LensChoice(ray_lens=PLAIN)
    size = camera.width, camera.height
    if model == SPLINED:
        scores = _score_ray_lenses(SPLINES, views, board, size, progress)
        if not scores:
            raise NoFitError()
        return LensChoice(None, simplest_model(scores, MIN_LENS_IMPROVEMENT), _by_name(scores))
    held_out: dict[str, float] = {}
    solved: dict[int, OpenCVFit] = {}
    if count is None:
        from calib.intrinsics.lens_order import choose_order

        name, held_out, solved = choose_order(
            views, board, size, progress, with_fisheye=camera.lens is None
        )
        if name == FISHEYE:
            return LensChoice(ray_lens=PLAIN, held_out=held_out)
        count = int(name)
    if model == OPENCV:
        return LensChoice(count, None, held_out, solved)
    held_out = {
        str(count): clipped_mean(
            held_out_errors(
                views, board, lambda training, _: fit_opencv(training, board, size, count)
            )
        )
    }
    scores = _score_ray_lenses((PLAIN, *SPLINES), views, board, size, progress)
    opencv_error = held_out[str(count)]
    held_out |= _by_name(scores)
    better = {
        lens: error
        for lens, error in scores.items()
        if error < (1 - MIN_LENS_IMPROVEMENT) * opencv_error
    }
    return LensChoice(
        count, simplest_model(better, MIN_LENS_IMPROVEMENT) if better else None, held_out
    )


def fit_choice(
    choice: LensChoice, views: Sequence[View], board: Board, size: tuple[int, int]
) -> "OpenCVFit | LensFit":
    """Fit the chosen lens to views: all those of the choice, or some without its `solved`."""
    if not choice.ray_lens:
        return best_of_starts(views, board, size, choice.count or 0, choice.solved)
    from calib.intrinsics.ray_lens_fit import fit_lens

    return fit_lens(choice.ray_lens, views, board, size)


def _score_ray_lenses(
    lenses: Sequence[RayLens],
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    progress: Progress,
) -> dict[RayLens, float]:
    """Return the error of each lens on held-out views, from the simplest lens to the first spline
    that is worse than a simpler lens. A lens that cannot see such views has no score.
    """
    from calib.intrinsics.ray_lens_fit import fit_lens

    advance = progress.task("Lens models", len(lenses))
    plain: dict[int, LensFit] = {}
    scores: dict[RayLens, float] = {}

    def fit_ray_lens(lens: RayLens, training: Sequence[View], fold: int) -> "LensFit":
        if fold not in plain:
            plain[fold] = fit_lens(PLAIN, training, board, size)
        if lens == PLAIN:
            return plain[fold]
        return fit_lens(lens, training, board, size, plain[fold])

    for done, lens in enumerate(lenses, 1):
        with suppress(NotEnoughDataError):
            scores[lens] = clipped_mean(held_out_errors(views, board, partial(fit_ray_lens, lens)))
        advance(done, str(lens))
        if lens.columns and scores.get(lens, np.inf) > min(scores.values(), default=np.inf):
            break  # a finer spline is even worse
    return scores


def _by_name(scores: dict[RayLens, float]) -> dict[str, float]:
    return {str(lens): error for lens, error in scores.items()}
