"""Cross-validation over views: the error of a fit on views that it was not fitted to."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.corners.folds import split_folds
from calib.corners.view import View, pose_labels
from calib.estimation.model_choice import simplest_model
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fit_record.outcome import CrossValidation
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Progress, Silent
from calib.threads import single_thread

GRIDS = ((6, 6), (8, 8), (12, 12), (16, 16))
"""The grids that `--grid auto` compares, coarse to fine."""
GRID_FOLDS = 4
MIN_IMPROVEMENT = 0.01
"""A finer grid must lower the held-out error by this fraction."""


def cross_validate(
    setup: Setup, views: Sequence[View], settings: Settings, folds: int, progress: Progress
) -> CrossValidation:
    """Fit `folds` times, each time without every folds-th pose of the board, and measure the views
    of the omitted poses.

    Raises:
        NotEnoughDataError: too few views are left to fit.
    """
    pose = pose_labels(views)
    advance = progress.task(
        f"{folds} folds"
        + (f", grid {settings.grid[0]}x{settings.grid[1]}" if settings.grid else ""),
        folds,
    )
    squares = np.zeros(pose.max() + 1)  # px^2 of each pose
    counts = np.zeros(pose.max() + 1)  # corners of each pose
    fitted_squares = 0.0  # px^2
    corners = 0
    with single_thread():
        for index, fold in enumerate(split_folds(views, folds)):
            fitted = fit_stages(
                setup, Observations.of(fold.training, setup.board), settings, Silent()
            )
            test = Observations.of(fold.test, setup.board)
            poses = pinhole_poses(fitted.path, fitted.values, test)
            _, residual = refit_poses(fitted.path, fitted.values, test, poses)
            for number, image in zip(
                pose[fold.held_out], test.per_view(residual.image), strict=True
            ):
                squares[number] += float(image.square().nansum())
                counts[number] += int(image.isfinite().all(1).sum())
            fitted_squares += fitted.residuals.rms_px**2 * len(test.pixels)
            corners += len(test.pixels)
            advance(index + 1, f"{residual.rms_px:.3f} px held out")
    error = float(np.sqrt(squares.sum() / counts.sum()))
    spread = float(
        np.sqrt(
            np.square(squares - error**2 * counts).sum() * len(counts) / max(1, len(counts) - 1)
        )
    )
    # the standard deviation of the mean square, carried over to its root to first order
    sigma = spread / counts.sum() / (2 * error) if error else 0.0
    return CrossValidation(folds, error, (fitted_squares / corners) ** 0.5, float(sigma))


def choose_grid(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress
) -> tuple[tuple[int, int], dict[str, float]]:
    """Return the coarsest of GRIDS that no finer one beats by MIN_IMPROVEMENT on held-out views,
    and the held-out error of each tried grid, in px.

    Finer grids are tried as long as they help.
    """
    errors: dict[tuple[int, int], float] = {}
    for grid in GRIDS:
        error = cross_validate(
            setup, views, replace(settings, grid=grid), GRID_FOLDS, progress
        ).held_out_px
        lowest = min(errors.values(), default=math.inf)
        errors[grid] = error
        if error >= (1 - MIN_IMPROVEMENT) * lowest:
            break
    return simplest_model(errors, MIN_IMPROVEMENT), {
        f"{around}x{axial}": error for (around, axial), error in errors.items()
    }
