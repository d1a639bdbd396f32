"""The map of one depth over a whole picture, as cv2.remap takes it, from the inverse at a few
nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import Mask, cell
from calib.undistortion.inverse import Inverse
from calib.undistortion.window import Window

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class DepthMap:
    """Where the distorted picture holds each undistorted pixel, for cv2.remap."""

    depth: float
    """m"""
    x: Image
    """(height, width) px; -1 where not valid."""
    y: Image
    """(height, width) likewise"""
    valid: Mask
    """(height, width), false where the camera does not see that direction through its cover."""


def depth_map(
    inverse: Inverse, depth: float, window: Window, sees: Callable[[Image, Image, float], Mask]
) -> DepthMap:
    """Spline the inverse onto every pixel of the window's picture.

    Args:
        inverse: of the same window, at that depth.
        depth: m
        sees: whether the camera sees as near as a depth in m at distorted px x and y, (rows, width)
            each.
    """
    shape = window.height, window.width
    made = DepthMap(
        depth, np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.bool_)
    )
    whole = bool(inverse.cells.all())
    column, row = (
        cell(np.arange(size), nodes)
        for size, nodes in ((window.width, inverse.columns), (window.height, inverse.rows))
    )
    for rows, (x, y) in inverse.spline.strips(window.width, window.height):
        valid = sees(x, y, depth)
        if not whole:
            valid &= inverse.cells[row[rows]][:, column]
        if not valid.all():
            np.copyto(x, -1, where=~valid)
            np.copyto(y, -1, where=~valid)
        made.x[rows], made.y[rows], made.valid[rows] = x, y, valid
    return made
