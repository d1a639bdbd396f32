"""Which corners are not where those around them say."""

import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.session.board import Board

FEWEST = 4
"""Corners that tell something of others."""
FOUND_NOISE = 0.1  # px, of a board's corners
STRAY = 0.05  # of the distance of two corners: how far one may be from where it and others say
LEAST_STRAY = 0.7  # px: at least
MOST_OWN = 0.98  # of what is said of a corner: beyond, others say hardly anything


def without_strays(
    corners: NDArray[np.float64], board: Board, *, by_others: bool = False
) -> NDArray[np.float64]:
    """(count, 2) px, NaN where a corner is not where it and those around it say, or those around it
    alone; the farthest first.
    """
    unit = 2 * board.half[0] / (board.columns - 1)
    kept = corners.copy()
    while (seen := np.flatnonzero(np.isfinite(kept[:, 0]))).size >= FEWEST:
        points = board.points()[seen] / unit
        near = LocalMap.of(points, kept[seen], points, FOUND_NOISE)
        allowed = np.maximum(STRAY * np.linalg.norm(near.steps, axis=-1).min(1), LEAST_STRAY)
        off = np.linalg.norm(near.pixels - kept[seen], axis=1) / allowed
        if by_others:
            off /= 1 - np.minimum(near.leverage, MOST_OWN)
        if off.max() <= 1:
            break
        kept[seen[off >= max(off.max() / 2, 1)]] = np.nan
    return kept
