"""Measure located corners and their uncertainty, and reject those that do not look like corners
after all.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice
from calib.corners.patch_fit import PatchFit, fit_patches
from calib.corners.patch_model import BLURS, CONTRAST
from calib.session.board import Board

# of the square's height, and at least a pixel: how far a corner may lie from its located place
MAX_SHIFT = 0.15
MIN_CONTRAST = 0.2  # of the median contrast
MAX_MISFIT_RATIO = 3.0  # times the median misfit
ACCEPTED_MISFIT = 0.1  # of the contrast: a smaller misfit is never a reason to reject a corner
MAX_SIGMA = 0.5  # px

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredCorners:
    """The measured corners of one board in a picture."""

    corners: Floats
    """(count, 2) px, NaN where the picture does not show one of this board's corners at a located
    place: it is covered, or saturated.
    """
    covariances: Floats
    """(count, 2, 2) px^2; NaN where `corners` is NaN."""
    blurs: Floats
    """(count, 2) px, as in `View.blur`; NaN where `corners` is NaN."""


def measure_corners(
    grey: NDArray, corners: Floats, board: Board, lattice: Lattice | None = None
) -> MeasuredCorners:
    """Measure located corners.

    Args:
        grey: (H, W) uint8 or uint16.
        corners: (count, 2) px, a regular grid, each wrong by less than a blur. Some may be NaN.
        board: its columns and rows.
        lattice: the lattice of the corners that are not NaN. None: it is taken from the corners.
    """
    fit = fit_patches(grey, corners, board, lattice)
    accepted = _looks_like_corners(fit, corners, board)
    index = np.flatnonzero(np.isfinite(corners[:, 0]))[accepted]
    places, covariances = np.full((board.count, 2), np.nan), np.full((board.count, 2, 2), np.nan)
    blurs = np.full((board.count, 2), np.nan)
    places[index] = corners[index] + fit.parameters[accepted, :2]
    unit = fit.unit_covariances[accepted]
    covariances[index] = (
        fit.noise_inflation * (unit + unit.swapaxes(1, 2)) / 2
    )  # symmetric to the last digit
    blurs[index] = np.exp(fit.parameters[accepted, BLURS])
    return MeasuredCorners(places, covariances, blurs)


def _looks_like_corners(fit: PatchFit, corners: Floats, board: Board) -> NDArray[np.bool_]:
    """Return (N,), true for each corner that is not NaN and looks like one."""
    row, column = np.divmod(np.flatnonzero(np.isfinite(corners[:, 0])), board.columns)
    contrast = fit.parameters[:, CONTRAST] * np.where((row + column) % 2, -1, 1)
    usual = np.median(contrast)
    # A board's outer corner is fitted by contrasts that are not there.
    misfit = fit.misfit * np.maximum(np.abs(contrast / usual), 1)
    moved = np.linalg.norm(fit.parameters[:, :2], axis=1)
    (xx, xy), (_, yy) = np.moveaxis(fit.unit_covariances, 0, -1)
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)  # of the eigenvalues
    return np.asarray(
        (moved <= np.maximum(MAX_SHIFT * fit.heights.min(1), 1))
        & (contrast * np.sign(usual) >= MIN_CONTRAST * abs(usual))
        & (misfit <= max(MAX_MISFIT_RATIO * float(np.median(misfit)), ACCEPTED_MISFIT))
        & (half < middle * (1 - 1e-6))  # where hardly any pixel has information, rounding decides
        & (fit.noise_inflation * (middle + half) <= MAX_SIGMA**2)
    )
