"""Bicubic splines through values on an evenly spaced grid: the field of rays, and the maps made of
it, between their nodes.

A spline is a sum of uniform cubic B-splines, one for each node and one more beyond each end. Its
third derivative does not jump at the nodes next to the ends ("not a knot": de Boor, A Practical
Guide to Splines, chapter IV), as with scipy's make_interp_spline. docs/decisions/splines.md says
what scipy does here and what it does not, with timings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.sparse import csr_array

Array = NDArray[np.float64]

FEWEST = 6
"""Nodes on each side that the conditions at both ends need."""
AT_ONCE = 4096
"""Points that are evaluated together: their weights stay in the cache, which makes 40,000 up to a
quarter faster.
"""


@dataclass(frozen=True, slots=True)
class Spline:
    """A function of x and y with c components, twice continuously differentiable, that takes given
    values at the nodes.

    Coordinates may have any unit; values keep theirs, and derivatives are values per coordinate.
    """

    nodes_x: Array
    """(w,) ascending, evenly spaced, FEWEST or more"""
    nodes_y: Array
    """(h,) likewise"""
    coefficients: Array
    """(h + 2, w + 2, c) of the products of B-splines along y and x."""

    @staticmethod
    def through(nodes_x: Array, nodes_y: Array, values: Array) -> Spline:
        """The spline with (h, w, c) finite values at (w,) and (h,) nodes.

        scipy's make_interp_spline leaves out the knots next to the ends, where `at` needs even
        ones; with the change of its coefficients to even knots it takes 1.4 to 1.6 times as long as
        this (benchmarks.splines).
        """
        down = _coefficients(values)  # (h + 2, w, c)
        return Spline(
            nodes_x,
            nodes_y,
            np.ascontiguousarray(_coefficients(down.swapaxes(0, 1)).swapaxes(0, 1)),
        )

    def at(self, points: Array) -> tuple[Array, Array]:
        """Evaluate at scattered points.

        scipy's NdBSpline takes 1.0 (40,000 points on 59x45 nodes) to 3.1 times as long for values
        and derivatives (benchmarks.splines): it seeks each point's knots from the first one on, and
        again for each derivative, where even knots need a division.

        Args:
            points: (N, 2) x and y. Beyond the nodes the spline goes on as its tangent plane at the
                nearest point of their rectangle.

        Returns:
            (N, c) values, and (N, c, 2) derivatives by x and y (beyond the nodes, those at the
            nearest point of their rectangle).
        """
        parts = [
            self._at(points[first : first + AT_ONCE])
            for first in range(0, max(1, len(points)), AT_ONCE)
        ]
        values, derivatives = zip(*parts, strict=True)
        return np.concatenate(values), np.concatenate(derivatives)

    def values(self, points: Array) -> Array:
        """(N, c) at (N, 2) points within the nodes, in a third of the time of `at`."""
        parts = [
            self._products(points[first : first + AT_ONCE], slopes=False)[0](0, 0)
            for first in range(0, max(1, len(points)), AT_ONCE)
        ]
        return np.concatenate(parts)

    def on_grid(self, xs: Array, ys: Array) -> Array:
        """(len(ys), len(xs), c) values where the ascending coordinates cross, all within the
        nodes.
        """
        h, w, c = self.coefficients.shape
        tall = (
            (_design(ys, self.nodes_y) @ self.coefficients.reshape(h, w * c))
            .reshape(len(ys), w, c)
            .swapaxes(0, 1)
        )
        return (
            np.asarray(_design(xs, self.nodes_x) @ tall.reshape(w, -1))
            .reshape(len(xs), len(ys), c)
            .swapaxes(0, 1)
        )

    def strips(self, width: int, height: int) -> Iterator[tuple[slice, list[NDArray[np.float32]]]]:
        """The values at every pixel of a picture of width x height px within the nodes, whose
        coordinates are px.

        Yields:
            From top to bottom, which rows, and c arrays (rows, width). The rows between two nodes
            share their coefficients, so each strip is a product of small matrices and stays in the
            cache.
        """
        across = _design(np.arange(width, dtype=np.float64), self.nodes_x)
        wide = [
            np.ascontiguousarray((across @ part.T).T, dtype=np.float32)
            for part in np.moveaxis(self.coefficients, -1, 0)
        ]
        down = _design(np.arange(height, dtype=np.float64), self.nodes_y)
        first, weights = (
            down.indices[::4],
            down.data.reshape(-1, 4).astype(np.float32),
        )  # design matrices store four numbers a row
        begin = 0
        for end in (*(np.flatnonzero(np.diff(first)) + 1).tolist(), height):
            rows, four = slice(begin, end), slice(int(first[begin]), int(first[begin]) + 4)
            yield rows, [np.asarray(weights[rows] @ part[four], dtype=np.float32) for part in wide]
            begin = end

    def _at(self, points: Array) -> tuple[Array, Array]:
        weighted, inside = self._products(points)
        derivatives = np.stack([weighted(0, 1), weighted(1, 0)], -1)
        beyond = points - inside
        return (
            weighted(0, 0)
            + derivatives[..., 0] * beyond[:, :1]
            + derivatives[..., 1] * beyond[:, 1:],
            derivatives,
        )

    def _products(
        self, points: Array, *, slopes: bool = True
    ) -> tuple[Callable[[int, int], Array], Array]:
        """A function from 0 or, if `slopes`, 1 derivatives by y and by x to (N, c), and the (N, 2)
        points at which it has them, within the nodes.
        """
        inside = np.clip(
            points, [self.nodes_x[0], self.nodes_y[0]], [self.nodes_x[-1], self.nodes_y[-1]]
        )
        column, *across = _basis(inside[:, 0], self.nodes_x, slopes=slopes)
        row, *down = _basis(inside[:, 1], self.nodes_y, slopes=slopes)
        wide = self.coefficients.shape[1]
        near = (np.arange(4, dtype=np.int32)[:, None] * wide + np.arange(4, dtype=np.int32)).ravel()
        indices = ((row * wide + column).astype(np.int32)[:, None] + near).ravel()
        starts = np.arange(0, indices.size + 1, 16, dtype=np.int32)
        flat = self.coefficients.reshape(-1, self.coefficients.shape[-1])

        def weighted(by_y: int, by_x: int) -> Array:
            weights = (down[by_y][:, :, None] * across[by_x][:, None, :]).ravel()
            return np.asarray(
                csr_array((weights, indices, starts), (len(points), len(flat))) @ flat
            )

        return weighted, inside


def _coefficients(values: Array) -> Array:
    """(n, ...) values at nodes to (n + 2, ...) coefficients along the first axis."""
    n = len(values)
    band = np.zeros((9, n + 2))  # band[4 + i - j, j] is row i, column j
    nodes = np.arange(1, n + 1)
    for offset, weight in ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6)):
        band[4 - offset, nodes + offset] = weight
    for k, weight in enumerate(
        (1.0, -4.0, 6.0, -4.0, 1.0)
    ):  # no jump of the third derivative at the nodes next to the ends
        band[4 - k, k] = band[8 - k, n - 3 + k] = weight
    right = np.zeros((n + 2, values[0].size))
    right[1:-1] = values.reshape(n, -1)
    return np.asarray(solve_banded((4, 4), band, right)).reshape(n + 2, *values.shape[1:])


def _basis(at: Array, nodes: Array, *, slopes: bool) -> tuple[NDArray[np.intp], *tuple[Array, ...]]:
    """Which B-splines are not zero at (N,) coordinates within the nodes.

    Returns:
        (N,) the first of four coefficients, and (N, 4) what each of them contributes to the value;
        if `slopes`, (N, 4) to the derivative.
    """
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    t = (at - nodes[0]) / step
    first = np.clip(t.astype(np.intp), 0, len(nodes) - 2)
    f = t - first
    g = 1 - f
    ff, gg = f * f, g * g
    fff, ggg = ff * f, gg * g
    weights = np.stack([ggg, 3 * fff - 6 * ff + 4, 3 * ggg - 6 * gg + 4, fff], -1)
    weights /= 6
    if not slopes:
        return first, weights
    return first, weights, np.stack([-gg, f * (3 * f - 4), g * (4 - 3 * g), ff], -1) / (2 * step)


def _design(at: Array, nodes: Array) -> csr_array:
    """(len(at), len(nodes) + 2): from coefficients to values."""
    from scipy.interpolate import BSpline  # for maps: a field's own points do without

    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    return BSpline.design_matrix(
        at, nodes[0] + step * np.arange(-3, len(nodes) + 3), 3, extrapolate=True
    )
