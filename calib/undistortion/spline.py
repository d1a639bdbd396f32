"""Bicubic splines through values on an evenly spaced grid. They interpolate the field of rays, and
the maps computed from it, between their nodes.

A spline is a sum of uniform cubic B-splines, one for each node and one more beyond each end. Its
third derivative does not jump at the nodes next to the ends ("not a knot": de Boor, A Practical
Guide to Splines, chapter IV), as in scipy's make_interp_spline. docs/decisions/splines.md says
where this code uses scipy and where it does not, with timings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.sparse import csr_array

Array = NDArray[np.float64]

MIN_NODES = 6
"""The smallest number of nodes on each side: the conditions at both ends need as many."""
BATCH_SIZE = 4096
"""The number of points that are evaluated together. Their weights stay in the cache, which makes
40,000 points up to a quarter faster.
"""


@dataclass(frozen=True, slots=True)
class Spline:
    """A twice continuously differentiable function of x and y with c components that interpolates
    values at nodes.

    Coordinates may have any unit; values keep theirs, and derivatives are values per coordinate.
    """

    nodes_x: Array
    """(w,) ascending, evenly spaced, at least MIN_NODES"""
    nodes_y: Array
    """(h,) ascending, evenly spaced, at least MIN_NODES"""
    coefficients: Array
    """(h + 2, w + 2, c) coefficients of the products of B-splines along y and x."""

    @staticmethod
    def through(nodes_x: Array, nodes_y: Array, values: Array) -> Spline:
        """Return the spline that has (h, w, c) finite values at (w,) and (h,) nodes.

        scipy's make_interp_spline leaves out the knots next to the ends, where `at` needs even
        knots. With the conversion of its coefficients to even knots it takes 1.4 to 1.6 times as
        long as this (benchmarks.splines).
        """
        vertical = _coefficients(values)  # (h + 2, w, c)
        coefficients = _coefficients(vertical.swapaxes(0, 1)).swapaxes(0, 1)
        return Spline(nodes_x, nodes_y, np.ascontiguousarray(coefficients))

    def at(self, points: Array) -> tuple[Array, Array]:
        """Evaluate at scattered points.

        scipy's NdBSpline takes 1.0 (40,000 points on 59x45 nodes) to 3.1 times as long for values
        and derivatives (benchmarks.splines): it searches each point's knots from the first one, and
        again for each derivative, where even knots need a division.

        Args:
            points: (N, 2) x and y. Beyond the nodes the spline continues as its tangent plane at
                the nearest point of their rectangle.

        Returns:
            (N, c) values, and (N, c, 2) derivatives by x and y (beyond the nodes, those at the
            nearest point of their rectangle).
        """
        batches = [
            self._at(points[first : first + BATCH_SIZE])
            for first in range(0, max(1, len(points)), BATCH_SIZE)
        ]
        values, derivatives = zip(*batches, strict=True)
        return np.concatenate(values), np.concatenate(derivatives)

    def values(self, points: Array) -> Array:
        """Return the (N, c) values at (N, 2) points within the nodes, in a third of the time of
        `at`.
        """
        batches = [
            self._products(points[first : first + BATCH_SIZE], slopes=False)[0](0, 0)
            for first in range(0, max(1, len(points)), BATCH_SIZE)
        ]
        return np.concatenate(batches)

    def on_grid(self, xs: Array, ys: Array) -> Array:
        """Return the (len(ys), len(xs), c) values at the grid of two ascending lists of
        coordinates, all within the nodes.
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
        """Yield the values at every pixel of a picture of width x height px, whose coordinates are
        px and lie within the nodes.

        Yields:
            From top to bottom: a slice of rows, and c arrays (rows, width). The rows between two
            nodes share their coefficients, so each strip is a product of small matrices and stays
            in the cache.
        """
        design_x = _design(np.arange(width, dtype=np.float64), self.nodes_x)
        horizontal = [
            np.ascontiguousarray((design_x @ component.T).T, dtype=np.float32)
            for component in np.moveaxis(self.coefficients, -1, 0)
        ]
        design_y = _design(np.arange(height, dtype=np.float64), self.nodes_y)
        first = design_y.indices[::4]  # a design matrix stores four numbers a row
        weights = design_y.data.reshape(-1, 4).astype(np.float32)
        start = 0
        for end in (*(np.flatnonzero(np.diff(first)) + 1).tolist(), height):
            rows = slice(start, end)
            four = slice(int(first[start]), int(first[start]) + 4)
            values = [
                np.asarray(weights[rows] @ component[four], dtype=np.float32)
                for component in horizontal
            ]
            yield rows, values
            start = end

    def _at(self, points: Array) -> tuple[Array, Array]:
        weighted, clipped = self._products(points)
        derivatives = np.stack([weighted(0, 1), weighted(1, 0)], -1)
        excess = points - clipped
        return (
            weighted(0, 0)
            + derivatives[..., 0] * excess[:, :1]
            + derivatives[..., 1] * excess[:, 1:],
            derivatives,
        )

    def _products(
        self, points: Array, *, slopes: bool = True
    ) -> tuple[Callable[[int, int], Array], Array]:
        """Return a function and the (N, 2) points clipped to the rectangle of the nodes. The
        function takes the order of the derivative by y and by x, 0 or (with `slopes`) 1 each, and
        returns its (N, c) values at the clipped points.
        """
        clipped = np.clip(
            points, [self.nodes_x[0], self.nodes_y[0]], [self.nodes_x[-1], self.nodes_y[-1]]
        )
        column, *basis_x = _basis(clipped[:, 0], self.nodes_x, slopes=slopes)
        row, *basis_y = _basis(clipped[:, 1], self.nodes_y, slopes=slopes)
        width = self.coefficients.shape[1]
        four = np.arange(4, dtype=np.int32)
        near = (four[:, None] * width + four).ravel()
        indices = ((row * width + column).astype(np.int32)[:, None] + near).ravel()
        starts = np.arange(0, indices.size + 1, 16, dtype=np.int32)
        flat = self.coefficients.reshape(-1, self.coefficients.shape[-1])

        def weighted(by_y: int, by_x: int) -> Array:
            weights = (basis_y[by_y][:, :, None] * basis_x[by_x][:, None, :]).ravel()
            return np.asarray(
                csr_array((weights, indices, starts), (len(points), len(flat))) @ flat
            )

        return weighted, clipped


def _coefficients(values: Array) -> Array:
    """Return the (n + 2, ...) coefficients along the first axis of (n, ...) values at nodes."""
    n = len(values)
    band = np.zeros((9, n + 2))  # band[4 + i - j, j] is row i, column j
    nodes = np.arange(1, n + 1)
    for offset, weight in ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6)):
        band[4 - offset, nodes + offset] = weight
    # The third derivative does not jump at the nodes next to the ends.
    for k, weight in enumerate((1.0, -4.0, 6.0, -4.0, 1.0)):
        band[4 - k, k] = band[8 - k, n - 3 + k] = weight
    right = np.zeros((n + 2, values[0].size))
    right[1:-1] = values.reshape(n, -1)
    return np.asarray(solve_banded((4, 4), band, right)).reshape(n + 2, *values.shape[1:])


def _basis(
    coordinates: Array, nodes: Array, *, slopes: bool
) -> tuple[NDArray[np.intp], *tuple[Array, ...]]:
    """Evaluate the B-splines that are not zero at (N,) coordinates within the nodes.

    Returns:
        (N,) the index of the first of four coefficients, and the (N, 4) values of their B-splines;
        with `slopes` also the (N, 4) derivatives.
    """
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    t = (coordinates - nodes[0]) / step
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


def _design(coordinates: Array, nodes: Array) -> csr_array:
    """Return the (len(coordinates), len(nodes) + 2) matrix from coefficients to values."""
    first, *basis = _basis(coordinates, nodes, slopes=False)
    indices = (first[:, None] + np.arange(4)).astype(np.int32).ravel()
    starts = np.arange(0, indices.size + 1, 4, dtype=np.int32)
    return csr_array((basis[0].ravel(), indices, starts), (len(coordinates), len(nodes) + 2))
