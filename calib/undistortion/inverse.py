"""The inverse of undistortion at one depth: which distorted pixel sees each undistorted one, by
Newton's method.

Undistortion is known as a spline over distorted pixels (Forward). Its inverse is solved at the
nodes of a grid over the undistorted picture. Where the spline through these solutions is not the
inverse between them, a finer grid is tried (Inverse).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calib.undistortion.grids import Array, Mask, all_corners, extrapolated, grid, inner, middles
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

COARSEST = 64
"""px between nodes, where the field is smooth."""
SPACING = 16
"""px between nodes, at most, where some cannot be solved."""
ACCEPTED = 0.005
"""px: how far a spline may be off where refinement has stopped; what is further off counts as not
valid.
"""
STARTS = 40_000
"""Nodes among which Newton's method seeks its start."""
NEWTON_STEPS = 15
LONGEST_STEP = 100.0
"""px: longer steps of Newton's method are shortened to this."""
CONVERGED = 1e-6
"""px: the length of a step of Newton's method that is its last."""
FOLDED = 1e-3
"""The least determinant of undistortion's Jacobian: next to where no ray leaves the cover it goes
through zero.
"""

Undistort = Callable[[Array, NDArray[np.intp]], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class Forward:
    """Undistortion at one depth: what is inverted."""

    nodes_x: Array
    """(w,) distorted px, evenly spaced"""
    nodes_y: Array
    """(h,) likewise"""
    values: Array
    """(h, w, 2) px of the bare pinhole camera"""
    valid: Mask
    """(h, w), false where no ray leaves the cover; the values are extrapolated there."""

    @property
    def spline(self) -> Spline:
        """From distorted px to px of the bare pinhole camera."""
        return Spline.through(self.nodes_x, self.nodes_y, self.values)

    def starts(self, goal: Array) -> Array:
        """(N, 2) distorted px from which Newton's method sets out for (N, 2) undistorted px: of
        some valid nodes, the one whose value is nearest; the goal itself where no node is valid.
        """
        every = max(1, int(np.ceil(np.sqrt(self.valid.size / STARTS))))
        some = slice(every // 2, None, every)
        valid = self.valid[some, some]
        if not valid.any():
            return goal.copy()
        nodes = np.stack(np.meshgrid(self.nodes_x[some], self.nodes_y[some]), -1)[valid]
        return np.asarray(nodes[KDTree(self.values[some, some][valid]).query(goal)[1]])


@dataclass(frozen=True, slots=True)
class Inverse:
    """Distorted pixels on an even grid over a picture, at one depth."""

    columns: Array
    """(w,) px of the picture."""
    rows: Array
    """(h,) px"""
    nodes: Array
    """(h, w, 2) distorted px."""
    cells: Mask
    """(h - 1, w - 1) whether the spline through the nodes is the inverse between them."""

    @property
    def spline(self) -> Spline:
        """From px of the picture to distorted px."""
        return Spline.through(self.columns, self.rows, self.nodes)


def invert(forward: Forward, window: Window) -> Inverse:
    """Solve on finer and finer grids, down to the spacing of `forward`, until the spline between
    the nodes is the inverse, too.
    """
    for spacing in spacings(min(SPACING, float(forward.nodes_x[1] - forward.nodes_x[0]))):
        columns, rows = (
            grid(size, spacing / zoom, 0.0)
            for size, zoom in zip((window.width, window.height), window.zoom, strict=True)
        )
        inverse, sure = invert_on(forward, window, columns, rows)
        if inverse.cells.all() or (spacing <= SPACING and inverse.cells[inner(sure)].all()):
            break
    return inverse


def invert_on(
    forward: Forward, window: Window, columns: Array, rows: Array
) -> tuple[Inverse, Mask]:
    """Solve at the nodes of one grid.

    Args:
        columns: (w,) px of the picture.
        rows: (h,) px of the picture.

    Returns:
        The inverse, extrapolated to nodes that no distorted pixel sees, and (h - 1, w - 1) between
        which four nodes it exists.
    """
    spline = forward.spline
    goal = _goal(window, columns, rows)
    flat = goal.reshape(-1, 2)
    found, converged = solve(lambda pixels, _: spline.at(pixels), forward.starts(flat), flat)
    converged = converged.reshape(goal.shape[:2])
    sure = all_corners(converged)
    if not sure.any():
        return Inverse(columns, rows, goal, sure), sure
    nodes = goal + extrapolated(found.reshape(goal.shape) - goal, converged)
    return (
        Inverse(columns, rows, nodes, sure & _inverts(spline, window, columns, rows, nodes)),
        sure,
    )


def spacings(finest: float) -> Iterator[float]:
    """From coarse to fine.

    Above SPACING a grid will do only if nothing on it fails: it would draw the edge of what fails
    too coarsely.
    """
    spacing = float(COARSEST)
    while spacing >= finest:
        yield spacing
        spacing /= 2


def solve(
    undistort: Undistort, starts: Array, goal: Array, last: float = CONVERGED
) -> tuple[Array, Mask]:
    """Newton's method at N points at once.

    Args:
        undistort: from (n, 2) distorted px, and (n,) which of the N they are, to (n, 2) undistorted
            px and their (n, 2, 2) Jacobians.
        starts: (N, 2) distorted px.
        goal: (N, 2) undistorted px.
        last: px: the length of a step that is the last one. What it leaves is of the order of its
            square times the curvature.

    Returns:
        (N, 2) distorted px, and (N,) whether the method converged.
    """
    found = starts.copy()
    remaining = np.arange(len(goal))
    for _ in range(NEWTON_STEPS):
        reached, jacobian = undistort(found[remaining], remaining)
        step, folded = newton_step(reached - goal[remaining], jacobian)
        length = np.hypot(step[:, 0], step[:, 1])
        found[remaining] -= step * np.minimum(1, LONGEST_STEP / np.maximum(length, 1e-12))[:, None]
        remaining = remaining[folded | ~(length <= last)]
        if not len(remaining):
            break
    converged = np.ones(len(goal), dtype=bool)
    converged[remaining] = False
    return found, converged


def newton_step(error: Array, jacobian: Array) -> tuple[Array, Mask]:
    """The step of Newton's method, to be subtracted.

    Args:
        error: (N, 2) undistorted px minus the goal.
        jacobian: (N, 2, 2) of undistorted by distorted px.

    Returns:
        (N, 2) distorted px, and (N,) whether the Jacobian's determinant is below FOLDED: there the
        step is the error itself.
    """
    (a, b), (c, d) = jacobian[:, 0].T, jacobian[:, 1].T
    det = a * d - b * c
    folded = ~(det >= FOLDED)
    safe = np.where(folded, 1.0, det)
    x, y = error.T
    step = np.stack([(d * x - b * y) / safe, (a * y - c * x) / safe], -1)
    step[folded] = error[folded]
    return step, folded


def _goal(window: Window, columns: Array, rows: Array) -> Array:
    """(h, w, 2) px of the bare pinhole camera."""
    at: Array = np.stack(np.meshgrid(columns, rows), -1) * window.zoom + window.corner
    return at


def _inverts(forward: Spline, window: Window, columns: Array, rows: Array, nodes: Array) -> Mask:
    """(h - 1, w - 1) whether the spline through the (h, w, 2) distorted nodes is the inverse
    between them as well.
    """
    across, down = middles(columns), middles(rows)
    goal = _goal(window, across, down).reshape(-1, 2)
    reached, jacobian = forward.at(
        Spline.through(columns, rows, nodes).on_grid(across, down).reshape(-1, 2)
    )
    off, folded = newton_step(reached - goal, jacobian)
    return np.asarray(
        (~folded & (np.hypot(off[:, 0], off[:, 1]) < ACCEPTED)).reshape(len(down), len(across))
    )
