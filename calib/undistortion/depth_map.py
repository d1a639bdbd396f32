"""The map of one depth over the full picture, as cv2.remap takes it, from the inverse at the nodes
of a grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import Mask, cell_index
from calib.undistortion.inverse import InverseMap
from calib.undistortion.window import Window

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class DepthMap:
    """The position of each undistorted pixel in the distorted picture, for cv2.remap."""

    depth: float
    """m"""
    x: Image
    """(height, width) px; -1 where not valid."""
    y: Image
    """(height, width) px; -1 where not valid."""
    valid: Mask
    """(height, width), false where the camera does not see that direction through its cover."""


def depth_map(
    inverse: InverseMap, depth: float, window: Window, sees: Callable[[Image, Image, float], Mask]
) -> DepthMap:
    """Evaluate the inverse at every pixel of the window's picture.

    Args:
        inverse: the inverse of the same window, at that depth.
        depth: m
        sees: a function of distorted px x and y, (rows, width) each, and a depth in m: true where
            the camera sees points at that depth.
    """
    shape = window.height, window.width
    maps = DepthMap(
        depth, np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.bool_)
    )
    complete = bool(inverse.cells.all())
    column = cell_index(np.arange(window.width), inverse.columns)
    row = cell_index(np.arange(window.height), inverse.rows)
    for rows, (x, y) in inverse.spline.strips(window.width, window.height):
        valid = sees(x, y, depth)
        if not complete:
            valid &= inverse.cells[row[rows]][:, column]
        if not valid.all():
            np.copyto(x, -1, where=~valid)
            np.copyto(y, -1, where=~valid)
        maps.x[rows], maps.y[rows], maps.valid[rows] = x, y, valid
    return maps
