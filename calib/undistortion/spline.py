"""Cubic splines over evenly spaced nodes, evaluated fast: at scattered points with slopes, and on whole pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.sparse import csr_array

Array = NDArray[np.float64]

FEWEST = 6
"""Nodes on each side that the conditions at both ends need."""


@dataclass(frozen=True, slots=True)
class Spline:
    """A function of x and y that passes through its values at the nodes; not-a-knot at the ends."""

    nodes_x: Array
    """(w,) evenly spaced"""
    nodes_y: Array
    """(h,) evenly spaced"""
    coefficients: Array
    """(h + 2, w + 2, c) of uniform cubic B-splines."""

    @staticmethod
    def through(nodes_x: Array, nodes_y: Array, values: Array) -> Spline:
        """The spline with (h, w, c) values at the nodes."""
        down = _coefficients(values)  # (h + 2, w, c)
        return Spline(nodes_x, nodes_y, np.ascontiguousarray(_coefficients(down.swapaxes(0, 1)).swapaxes(0, 1)))

    def at(self, points: Array) -> tuple[Array, Array]:
        """The (N, c) values and (N, c, 2) derivatives by x and y at (N, 2) points; beyond the nodes, linear."""
        inside = np.clip(points, [self.nodes_x[0], self.nodes_y[0]], [self.nodes_x[-1], self.nodes_y[-1]])
        (column, across, slope_x), (row, down, slope_y) = _taps(inside[:, 0], self.nodes_x), _taps(inside[:, 1], self.nodes_y)
        wide = self.coefficients.shape[1]
        near = (np.arange(4, dtype=np.int32)[:, None] * wide + np.arange(4, dtype=np.int32)).ravel()
        indices = ((row * wide + column).astype(np.int32)[:, None] + near).ravel()
        starts = np.arange(0, indices.size + 1, 16, dtype=np.int32)
        flat = self.coefficients.reshape(-1, self.coefficients.shape[-1])

        def mixed(vertical: Array, horizontal: Array) -> Array:
            weights = (vertical[:, :, None] * horizontal[:, None, :]).ravel()
            return np.asarray(csr_array((weights, indices, starts), (len(points), len(flat))) @ flat)

        slopes = np.stack([mixed(down, slope_x), mixed(slope_y, across)], -1)
        beyond = points - inside
        return mixed(down, across) + slopes[..., 0] * beyond[:, :1] + slopes[..., 1] * beyond[:, 1:], slopes

    def on_grid(self, xs: Array, ys: Array) -> Array:
        """(len(ys), len(xs), c) values where the coordinates cross, all within the nodes."""
        h, w, c = self.coefficients.shape
        tall = (_weights(ys, self.nodes_y) @ self.coefficients.reshape(h, w * c)).reshape(len(ys), w, c).swapaxes(0, 1)
        return np.asarray(_weights(xs, self.nodes_x) @ tall.reshape(w, -1)).reshape(len(xs), len(ys), c).swapaxes(0, 1)

    def strips(self, width: int, height: int) -> Iterator[tuple[slice, list[NDArray[np.float32]]]]:
        """The values at every pixel of a picture of width x height, c of (rows, width), from top to bottom.

        The rows between two nodes share their coefficients, so each strip is a product of small matrices and stays in the cache.
        """
        across = _weights(np.arange(width, dtype=np.float64), self.nodes_x)
        wide = [np.ascontiguousarray((across @ part.T).T, dtype=np.float32) for part in np.moveaxis(self.coefficients, -1, 0)]
        first, down, _ = _taps(np.arange(height, dtype=np.float64), self.nodes_y)
        narrow = down.astype(np.float32)
        begin = 0
        for end in (*(np.flatnonzero(np.diff(first)) + 1).tolist(), height):
            rows, four = slice(begin, end), slice(int(first[begin]), int(first[begin]) + 4)
            yield rows, [np.asarray(narrow[rows] @ part[four], dtype=np.float32) for part in wide]
            begin = end


def _coefficients(values: Array) -> Array:
    """(n, ...) values at nodes to (n + 2, ...) coefficients along the first axis."""
    n = len(values)
    band = np.zeros((9, n + 2))  # band[4 + i - j, j] is row i, column j
    nodes = np.arange(1, n + 1)
    for offset, weight in ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6)):
        band[4 - offset, nodes + offset] = weight
    for k, weight in enumerate((1.0, -4.0, 6.0, -4.0, 1.0)):  # no jump of the third derivative at the nodes next to the ends
        band[4 - k, k] = band[8 - k, n - 3 + k] = weight
    right = np.zeros((n + 2, values[0].size))
    right[1:-1] = values.reshape(n, -1)
    return np.asarray(solve_banded((4, 4), band, right)).reshape(n + 2, *values.shape[1:])


def _taps(at: Array, nodes: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """The first of four coefficients (N,), their weights (N, 4) and these weights' derivatives (N, 4)."""
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    t = (at - nodes[0]) / step
    first = np.clip(t.astype(np.intp), 0, len(nodes) - 2)
    f = t - first
    g = 1 - f
    weights = np.stack([g**3, 3 * f**3 - 6 * f * f + 4, 3 * g**3 - 6 * g * g + 4, f**3], -1) / 6
    slopes = np.stack([-g * g, f * (3 * f - 4), g * (4 - 3 * g), f * f], -1) / (2 * step)
    return first, weights, slopes


def _weights(at: Array, nodes: Array) -> csr_array:
    """(len(at), len(nodes) + 2): coefficients to values."""
    first, weights, _ = _taps(at, nodes)
    indices = (first[:, None] + np.arange(4)).ravel().astype(np.int32)
    return csr_array((weights.ravel(), indices, np.arange(0, indices.size + 1, 4, dtype=np.int32)), (len(at), len(nodes) + 2))
