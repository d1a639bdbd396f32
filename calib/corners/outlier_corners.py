"""Corners that do not lie where their neighbours predict them."""

import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.session.board import Board

MIN_CORNERS = 4
"""Corners that a local map needs to predict others."""
CORNER_NOISE = 0.1  # px, of a board's located corners
# spacings of two corners: how far a corner may lie from the place that the local map predicts
MAX_DEVIATION = 0.05
MIN_ALLOWANCE = 0.7  # px: a deviation that is always allowed
# a corner's leverage on its own prediction: above it, the neighbours contribute hardly anything
MAX_LEVERAGE = 0.98


def remove_outlier_corners(
    corners: NDArray[np.float64], board: Board, *, by_neighbours: bool = False
) -> NDArray[np.float64]:
    """Set the corners to NaN that deviate from the local map, the largest deviations first.

    Args:
        corners: (count, 2) px, NaN where not visible.
        board: its rows, columns and spacings.
        by_neighbours: predict each corner from its neighbours alone; else the corner itself counts
            in its prediction, too.

    Returns:
        (count, 2) px, NaN where a corner is not visible or an outlier.
    """
    unit = 2 * board.half[0] / (board.columns - 1)
    inliers = corners.copy()
    while (visible := np.flatnonzero(np.isfinite(inliers[:, 0]))).size >= MIN_CORNERS:
        points = board.points()[visible] / unit
        local_map = LocalMap.fit(points, inliers[visible], points, CORNER_NOISE)
        allowance = np.maximum(
            MAX_DEVIATION * np.linalg.norm(local_map.steps, axis=-1).min(1), MIN_ALLOWANCE
        )
        deviation = np.linalg.norm(local_map.pixels - inliers[visible], axis=1) / allowance
        if by_neighbours:
            deviation /= 1 - np.minimum(local_map.leverage, MAX_LEVERAGE)
        if deviation.max() <= 1:
            break
        inliers[visible[deviation >= max(deviation.max() / 2, 1)]] = np.nan
    return inliers
