"""Cross-validation over views: what a fit leaves on views that it has not seen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.corners.view import View, pose_labels
from calib.estimation.model_choice import simplest_model
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fitting.stages import Settings, Setup, fit_stages
from calib.progress import Progress, Silent
from calib.threads import single_thread

GRIDS = ((6, 6), (8, 8), (12, 12), (16, 16))
"""What `--grid auto` chooses from, coarse to fine."""
GRID_FOLDS = 4
WORTH = 0.01
"""A finer grid must lower the held-out error by this fraction."""
OVERFITS = 1.25
"""Held-out over fitted error from which a fit is said to overfit, beyond what the fitted poses
explain.
"""


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """Every view was held out once; only its pose was refitted."""

    folds: int
    held_out_px: float
    """Root mean square two-dimensional reprojection error."""
    fitted_px: float
    """The same of the views that were fitted, over all folds."""
    held_out_sigma_px: float = 0.0
    """Standard deviation of the former, from how its views differ; 0 where that is not known."""

    @property
    def overfits(self) -> bool:
        return self.held_out_px > OVERFITS * self.fitted_px


def cross_validate(
    setup: Setup, views: Sequence[View], settings: Settings, folds: int, progress: Progress
) -> CrossValidation:
    """Fit `folds` times, each time without every folds-th pose of the board, and measure the views
    of those: a burst stays together.

    Raises:
        NotEnoughDataError: too few views are left to fit.
    """
    pose = pose_labels(views)
    fold_of = pose % folds
    advance = progress.task(
        f"{folds} folds"
        + (f", grid {settings.grid[0]}x{settings.grid[1]}" if settings.grid else ""),
        folds,
    )
    squares, counts = (
        np.zeros(pose.max() + 1),
        np.zeros(pose.max() + 1),
    )  # px^2 and corners of each pose
    fitted, corners = 0.0, 0
    with single_thread():
        for fold in range(folds):
            rest, own = (
                [view for view, out in zip(views, fold_of == fold, strict=True) if out == held]
                for held in (False, True)
            )
            found = fit_stages(setup, Observations.of(rest, setup.board), settings, Silent())
            test = Observations.of(own, setup.board)
            missed = refit_poses(found.path, found.values, test, pinhole_poses(test, found.values))[
                1
            ]
            for number, image in zip(
                pose[fold_of == fold], test.per_view(missed.image), strict=True
            ):
                squares[number] += float(image.square().nansum())
                counts[number] += int(image.isfinite().all(1).sum())
            fitted += found.residuals.rms_px**2 * len(test.pixels)
            corners += len(test.pixels)
            advance(fold + 1, f"{missed.rms_px:.3f} px held out")
    error = float(np.sqrt(squares.sum() / counts.sum()))
    apart = float(
        np.sqrt(
            np.square(squares - error**2 * counts).sum() * len(counts) / max(1, len(counts) - 1)
        )
    )
    sigma = (
        apart / counts.sum() / (2 * error) if error else 0.0
    )  # of the mean square, and of its root to first order
    return CrossValidation(folds, error, (fitted / corners) ** 0.5, float(sigma))


def choose_grid(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress
) -> tuple[tuple[int, int], dict[str, float]]:
    """The coarsest of GRIDS that no finer one beats by WORTH on held-out views, and the held-out
    error of each that was tried, in px.

    Finer grids are tried as long as they help.
    """
    errors: dict[tuple[int, int], float] = {}
    for grid in GRIDS:
        error = cross_validate(
            setup, views, replace(settings, grid=grid), GRID_FOLDS, progress
        ).held_out_px
        lowest = min(errors.values(), default=math.inf)
        errors[grid] = error
        if error >= (1 - WORTH) * lowest:
            break
    return simplest_model(errors, WORTH), {
        f"{around}x{along}": error for (around, along), error in errors.items()
    }
