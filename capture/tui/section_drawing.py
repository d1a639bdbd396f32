"""The cover from the side, drawn in dots. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from capture.tui.cells import DOTS

CAMERA = "<"
"""The camera, which looks to the right."""
MARGIN = 0.08
"""The fraction of the drawing that stays empty on each side."""


def draw_section(surfaces: Sequence[NDArray[np.float64]], columns: int, rows: int) -> str:
    """Return the lines of a drawing of a cover's surfaces and of the camera at the origin.

    Args:
        surfaces: (N, 2) points of each surface in one unit, to the right and downwards.
    """
    drawn = [surface for surface in surfaces if len(surface)]
    if not drawn:
        return ""
    points = np.concatenate([np.zeros((1, 2)), *drawn])
    low = points.min(0)
    size = np.maximum(points.max(0) - low, 1e-9)
    dots = np.array([2 * columns, 4 * rows])
    scale = float(((1 - 2 * MARGIN) * (dots - 1) / size).min())
    shift = (dots - 1 - scale * size) / 2 - scale * low

    lit = np.zeros((4 * rows, 2 * columns), dtype=np.int64)
    for surface in drawn:
        steps = np.linspace(0, 1, 8 * max(columns, rows))
        nodes = np.linspace(0, 1, len(surface))
        line = np.stack([np.interp(steps, nodes, surface[:, axis]) for axis in (0, 1)], -1)
        x, y = np.rint(scale * line + shift).astype(int).T
        lit[y, x] = 1
    patterns = (lit.reshape(rows, 4, columns, 2) * DOTS[:, None]).sum((1, 3))
    characters = [
        [chr(0x2800 + pattern) if pattern else " " for pattern in row] for row in patterns
    ]
    x, y = np.rint(shift).astype(int)
    characters[y // 4][x // 2] = CAMERA
    return "\n".join("".join(row).rstrip() for row in characters)
