"""Where to put the screen next, as a sentence."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

CELLS = 3
"""Parts of the picture along each side."""
FULL = 0.5
"""The fraction of a part with points, from which the part has some."""
ROWS = ("top", "middle", "bottom")
COLUMNS = ("left", "centre", "right")
STANCES = (
    "facing the camera, so near that it fills the picture",
    "twice as far away, turned by 30 degrees to the left",
    "near, tilted back by 30 degrees",
    "twice as far away, turned by 30 degrees to the right",
    "near, tilted forward by 30 degrees",
    "three times as far away, turned a little in its own plane",
    "near, turned by 20 degrees and tilted back by 20",
    "twice as far away, facing the camera",
)
"""Distances and directions, in their order: a cover is told by both."""
SPACING = 0.02
"""The side of a small square over the picture's width, for counting where points are."""


def next_stance(poses: Sequence[NDArray[np.float64]], width: int, height: int, count: int) -> str:
    """Return a sentence that says where to put the screen.

    Args:
        poses: (N, 2) px of the points of each pose so far.
        width: px, of the camera's picture.
        height: px.
        count: the number of poses that are there.
    """
    stance = STANCES[count % len(STANCES)]
    place = ""
    if poses and (cell := _emptiest(poses, width, height)) is not None:
        row, column = cell
        place = f", over the {ROWS[row]} {COLUMNS[column]} of the picture"
    return f"Put the screen {stance}{place}. Then let go of it, and press Take."


def _emptiest(
    poses: Sequence[NDArray[np.float64]], width: int, height: int
) -> tuple[int, int] | None:
    """Return row and column of the part of the picture with the fewest points."""
    side = SPACING * width
    columns, rows = int(np.ceil(width / side)), int(np.ceil(height / side))
    counts = np.zeros((rows, columns))
    for pixels in poses:
        u, v = np.clip(((pixels + 0.5) / side).astype(int), 0, (columns - 1, rows - 1)).T
        hit = np.zeros_like(counts, bool)
        hit[v, u] = True
        counts += hit
    shares = np.array(
        [
            [area.mean() for area in np.array_split(band, CELLS, axis=1)]
            for band in np.array_split(counts, CELLS, axis=0)
        ]
    )
    if shares.min() > FULL * max(1, len(poses) / 2):
        return None
    row, column = np.unravel_index(shares.argmin(), shares.shape)
    return int(row), int(column)
