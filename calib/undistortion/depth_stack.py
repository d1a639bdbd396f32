"""Undistortion with a depth for every pixel: the inverse as a polynomial in inverse depth.

For one undistorted pixel, the distorted pixel is a smooth function of inverse depth. So the inverse
at a few depths, the Chebyshev nodes between infinity and the nearest depth, gives a polynomial for
each pixel. The coefficients are as smooth over the picture as the maps, so splines hold them too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import Array, Mask, all_corners_true, cell_index
from calib.undistortion.inverse import MAX_ERROR, invert, invert_on_grid
from calib.undistortion.ray_field import RayField
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

DEGREES = range(2, 13)
TOLERANCE = 0.001
"""px: the largest difference between the polynomial and the inverse of a depth."""

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DepthStack:
    """The maps of all depths from `near` m to infinity."""

    field: RayField
    window: Window
    near: float
    """m"""
    columns: Array
    """(w,) px of the picture."""
    rows: Array
    """(h,) px"""
    cells: Mask
    """(h - 1, w - 1) true where the polynomial is the inverse at every depth."""
    spline: Spline
    """The spline from px of the picture to 2 (degree + 1) coefficients of polynomials in
    2 near / Z - 1, x and y in turn, lowest power first.
    """

    def map_at(self, depth: NDArray[np.floating]) -> tuple[Image, Image, Mask]:
        """Return the distorted px x and y (-1 where not valid) of a (height, width) depth image in
        m, and (height, width) true where they are valid. A pixel is not valid if its depth is
        unknown (NaN, or not above 0) or below `near`, or if the camera does not see it.
        """
        x = np.empty(depth.shape, np.float32)
        y = np.empty(depth.shape, np.float32)
        valid = np.empty(depth.shape, np.bool_)
        column = cell_index(np.arange(depth.shape[1]), self.columns)
        row = cell_index(np.arange(depth.shape[0]), self.rows)
        complete = bool(self.cells.all())
        for rows, powers in self.spline.strips(self.window.width, self.window.height):
            metres = depth[rows].astype(np.float32)
            strip_valid = metres >= self.near  # false for NaN
            metres = np.where(strip_valid, metres, np.float32(np.inf))
            t = np.float32(2 * self.near) / metres - np.float32(1)
            pixel = [power.copy() for power in powers[-2:]]
            for i in range(len(powers) - 4, -1, -2):
                for axis in range(2):
                    pixel[axis] *= t
                    pixel[axis] += powers[i + axis]
            strip_valid &= self.field.sees(pixel[0], pixel[1], metres)
            if not complete:
                strip_valid &= self.cells[row[rows]][:, column]
            x[rows] = np.where(strip_valid, pixel[0], np.float32(-1))
            y[rows] = np.where(strip_valid, pixel[1], np.float32(-1))
            valid[rows] = strip_valid
        return x, y, valid


def depth_stack(field: RayField, window: Window, near: float) -> DepthStack:
    """Return the stack of the lowest degree that agrees with the inverse of each depth."""
    columns, rows = _finest_nodes(field, window, (near, 2 * near, np.inf))
    corners = len(rows), len(columns)
    for degree in DEGREES:
        fit_points = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        check_points = np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
        inverses = [
            invert_on_grid(field.forward(_depth(t, near)), window, columns, rows)[0]
            for t in fit_points
        ]
        powers = np.tensordot(
            np.linalg.inv(np.vander(fit_points, increasing=True)),
            np.stack([inverse.nodes for inverse in inverses]),
            1,
        )
        worst, cells = np.zeros(corners), np.ones((corners[0] - 1, corners[1] - 1), dtype=bool)
        for t in (*fit_points, *check_points):
            exact, _ = invert_on_grid(field.forward(_depth(t, near)), window, columns, rows)
            visible = field.sees(exact.nodes[..., 0], exact.nodes[..., 1], np.inf)
            error = np.linalg.norm(
                np.tensordot(t ** np.arange(degree + 1), powers, 1) - exact.nodes, axis=-1
            )
            worst = np.maximum(worst, np.where(visible, error, 0))
            cells &= exact.cells | all_corners_true(~visible)
        cells &= all_corners_true(worst < MAX_ERROR)
        if worst.max() < TOLERANCE:
            break
    flat = np.moveaxis(powers, 0, 2).reshape(*corners, -1)
    return DepthStack(
        field, window, near, columns, rows, cells, Spline.through(columns, rows, flat)
    )


def _finest_nodes(
    field: RayField, window: Window, depths: tuple[float, ...]
) -> tuple[Array, Array]:
    """Return the columns and rows of the finest grid that one of the depths needs."""
    inverses = [invert(field.forward(depth), window) for depth in depths]
    finest = max(inverses, key=lambda inverse: inverse.cells.size)
    return finest.columns, finest.rows


def _depth(t: float, near: float) -> float:
    """Return the depth Z in m for t = 2 near / Z - 1."""
    return float(2 * near / (1 + t)) if t > -1 else np.inf
