"""Undistortion where every pixel has its own depth: the inverse as a polynomial in inverse depth.

For one undistorted pixel, the distorted one moves smoothly with inverse depth. So a few maps, at
the Chebyshev nodes between infinity and the nearest depth, give a polynomial for each pixel; its
coefficients are as smooth over the picture as the maps, and splines hold them too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import Array, Mask, all_corners, cell
from calib.undistortion.inverse import ACCEPTED, invert, invert_on
from calib.undistortion.ray_field import RayField
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

DEGREES = range(2, 13)
TOLERANCE = 0.001
"""px: how far the polynomial should be from the inverse of a depth."""

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
    """(h - 1, w - 1) where the polynomial is the inverse at every depth."""
    spline: Spline
    """From pixels of the picture to 2 (degree + 1) coefficients, of x and y in turn, lowest power
    first, of 2 near / Z - 1.
    """

    def map_at(self, depth: NDArray[np.floating]) -> tuple[Image, Image, Mask]:
        """The distorted px x, y (-1 where not valid) for a (height, width) depth image in m, and
        (height, width) whether they are valid: not where the depth is unknown (not above 0, or
        NaN), nearer than `near`, or not seen.
        """
        x, y, valid = (
            np.empty(depth.shape, np.float32),
            np.empty(depth.shape, np.float32),
            np.empty(depth.shape, np.bool_),
        )
        column, row = (
            cell(np.arange(depth.shape[1]), self.columns),
            cell(np.arange(depth.shape[0]), self.rows),
        )
        whole = bool(self.cells.all())
        for rows, powers in self.spline.strips(self.window.width, self.window.height):
            metres = depth[rows].astype(np.float32)
            known = metres >= self.near  # false for NaN
            metres = np.where(known, metres, np.float32(np.inf))
            t = np.float32(2 * self.near) / metres - np.float32(1)
            at = [power.copy() for power in powers[-2:]]
            for i in range(len(powers) - 4, -1, -2):
                for axis in range(2):
                    at[axis] *= t
                    at[axis] += powers[i + axis]
            known &= self.field.sees(at[0], at[1], metres)
            if not whole:
                known &= self.cells[row[rows]][:, column]
            for target, found in zip((x, y), at, strict=True):
                target[rows] = np.where(known, found, np.float32(-1))
            valid[rows] = known
        return x, y, valid


def depth_stack(field: RayField, window: Window, near: float) -> DepthStack:
    """The lowest degree that agrees with the inverse of each depth."""
    columns, rows = _finest(field, window, (near, 2 * near, np.inf))
    corners = len(rows), len(columns)
    for degree in DEGREES:
        at = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        between = np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
        solved = [invert_on(field.forward(_depth(t, near)), window, columns, rows)[0] for t in at]
        powers = np.tensordot(
            np.linalg.inv(np.vander(at, increasing=True)),
            np.stack([one.nodes for one in solved]),
            1,
        )
        off, cells = np.zeros(corners), np.ones((corners[0] - 1, corners[1] - 1), dtype=bool)
        for t in (*at, *between):
            exact, _ = invert_on(field.forward(_depth(t, near)), window, columns, rows)
            seen = field.sees(exact.nodes[..., 0], exact.nodes[..., 1], np.inf)
            missed = np.linalg.norm(
                np.tensordot(t ** np.arange(degree + 1), powers, 1) - exact.nodes, axis=-1
            )
            off = np.maximum(off, np.where(seen, missed, 0))
            cells &= exact.cells | all_corners(~seen)
        cells &= all_corners(off < ACCEPTED)
        if off.max() < TOLERANCE:
            break
    flat = np.moveaxis(powers, 0, 2).reshape(*corners, -1)
    return DepthStack(
        field, window, near, columns, rows, cells, Spline.through(columns, rows, flat)
    )


def _finest(field: RayField, window: Window, depths: tuple[float, ...]) -> tuple[Array, Array]:
    """The nodes of the finest grid that one of the depths needs."""
    inverses = [invert(field.forward(depth), window) for depth in depths]
    most = max(inverses, key=lambda inverse: inverse.cells.size)
    return most.columns, most.rows


def _depth(t: float, near: float) -> float:
    """m, of 2 near / Z - 1."""
    return float(2 * near / (1 + t)) if t > -1 else np.inf
