"""Corners that were found -> where they are, how sure that is, and which of them do not look like
corners after all.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice
from calib.corners.patch_fit import Fit, fit_patches
from calib.corners.patch_model import CONTRAST
from calib.session.board import Board

# of the square's height, and at least a pixel: what was found is nearer than that to the corner
FARTHEST = 0.15
FAINTEST = 0.2  # of the median contrast
STRANGEST = 3.0  # times the median misfit
ALWAYS_ALIKE = 0.1  # of the contrast: a misfit that is no reason for doubt
VAGUEST = 0.5  # px

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The corners of one board in a picture."""

    corners: Floats
    """(count, 2) px, NaN where the picture, though a corner was found, shows none of this board's:
    it is covered, or saturated.
    """
    covariances: Floats
    """(count, 2, 2) px^2, NaN likewise."""


def measure(
    grey: NDArray, corners: Floats, board: Board, lattice: Lattice | None = None
) -> Measured:
    """Measure what was found.

    Args:
        grey: (H, W) uint8 or uint16.
        corners: (count, 2) px, a regular grid, each off by less than a blur. Some may be NaN.
        board: its columns and rows.
        lattice: of those that are not NaN. None: as they themselves say.
    """
    fit = fit_patches(grey, corners, board, lattice)
    shown = _looks_like_corners(fit, corners, board)
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))[shown]
    places, covariances = np.full((board.count, 2), np.nan), np.full((board.count, 2, 2), np.nan)
    places[seen] = corners[seen] + fit.parameters[shown, :2]
    unit = fit.unit_covariances[shown]
    covariances[seen] = (
        fit.inflation * (unit + unit.swapaxes(1, 2)) / 2
    )  # symmetric to the last digit
    return Measured(places, covariances)


def _looks_like_corners(fit: Fit, corners: Floats, board: Board) -> NDArray[np.bool_]:
    """(N,) of the corners that are not NaN."""
    row, column = np.divmod(np.flatnonzero(np.isfinite(corners[:, 0])), board.columns)
    contrast = fit.parameters[:, CONTRAST] * np.where((row + column) % 2, -1, 1)
    usual = np.median(contrast)
    # A board's outer corner is fitted by contrasts that are not there.
    misfit = fit.misfit * np.maximum(np.abs(contrast / usual), 1)
    moved = np.linalg.norm(fit.parameters[:, :2], axis=1)
    (xx, xy), (_, yy) = np.moveaxis(fit.unit_covariances, 0, -1)
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)  # of the eigenvalues
    return np.asarray(
        (moved <= np.maximum(FARTHEST * fit.heights.min(1), 1))
        & (contrast * np.sign(usual) >= FAINTEST * abs(usual))
        & (misfit <= max(STRANGEST * float(np.median(misfit)), ALWAYS_ALIKE))
        & (half < middle * (1 - 1e-6))  # where next to nothing is told, rounding decides
        & (fit.inflation * (middle + half) <= VAGUEST**2)
    )
