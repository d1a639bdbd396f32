"""The map of one depth over the full picture, as cv2.remap takes it, from the inverse at the nodes
of a grid. Where the spline through the nodes is not the inverse, each pixel is solved by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import Mask, cell_index
from calib.undistortion.inverse import ForwardMap, InverseMap, solve_newton
from calib.undistortion.spline import Spline
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
    forward: ForwardMap,
    inverse: InverseMap,
    depth: float,
    window: Window,
    sees: Callable[[Image, Image, float], Mask],
) -> DepthMap:
    """Evaluate the inverse at every pixel of the window's picture.

    Args:
        forward: undistortion at that depth.
        inverse: the inverse of the same window, at that depth.
        depth: m
        sees: a function of distorted px x and y, (rows, width) each, and a depth in m: true where
            the camera sees points at that depth.
    """
    shape = window.height, window.width
    maps = DepthMap(
        depth, np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.bool_)
    )
    spline = None if inverse.cells.all() else forward.spline
    column = cell_index(np.arange(window.width), inverse.columns)
    row = cell_index(np.arange(window.height), inverse.rows)
    for rows, (x, y) in inverse.spline.strips(window.width, window.height):
        if spline is None:
            valid = sees(x, y, depth)
        else:
            solved = inverse.cells[row[rows]][:, column]
            solved |= _solve_pixels(spline, window, rows, ~solved, (x, y))
            valid = solved & sees(x, y, depth)
        if not valid.all():
            np.copyto(x, -1, where=~valid)
            np.copyto(y, -1, where=~valid)
        maps.x[rows], maps.y[rows], maps.valid[rows] = x, y, valid
    return maps


def _solve_pixels(
    spline: Spline, window: Window, rows: slice, wanted: Mask, pixels: tuple[Image, Image]
) -> Mask:
    """Solve the wanted pixels of a strip by Newton's method, into its (rows, width) distorted px x
    and y, which hold its starts. Those that start outside of the nodes are left out.

    Args:
        spline: undistortion.

    Returns:
        (rows, width) true where it converged.
    """
    for start, nodes in zip(pixels, (spline.nodes_x, spline.nodes_y), strict=True):
        wanted = wanted & (start >= nodes[0]) & (start <= nodes[-1])
    down, across = np.nonzero(wanted)
    goal = np.stack([across, down + rows.start], -1) * window.zoom + window.corner
    starts = np.stack([start[wanted] for start in pixels], -1).astype(np.float64)
    solved, converged = solve_newton(lambda pixel, _: spline.at(pixel), starts, goal)
    for start, solution in zip(pixels, solved.T, strict=True):
        start[wanted] = solution
    wanted[wanted] = converged
    return wanted
