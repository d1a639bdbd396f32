"""The inverse of undistortion at one depth: the distorted pixel that sees each undistorted pixel,
by Newton's method.

Undistortion is a spline over distorted pixels (ForwardMap). Its inverse (InverseMap) is solved at
the nodes of a grid over the undistorted picture. If the spline through these solutions is not the
inverse between the nodes, a finer grid follows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.grids import (
    Array,
    Mask,
    all_corners_true,
    extrapolate,
    grid_nodes,
    interior_cells,
    midpoints,
)
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

COARSEST = 64
"""px between the nodes of the first grid."""
SPACING = 16
"""The coarsest spacing, px, at which a grid may keep nodes without a solution."""
FEW_PIXELS = 8
"""The number of pixels for each node below which no finer grid follows: pixels of the other cells
are then solved one by one.
"""
MAX_ERROR = 0.005
"""px: the largest error of a spline after refinement; cells with a larger error are not valid."""
MAX_START_NODES = 40_000
"""The number of nodes among which the start of Newton's method is chosen."""
NEWTON_STEPS = 15
MAX_STEP = 100.0
"""px: longer steps of Newton's method are shortened to this length."""
CONVERGED = 1e-6
"""px: Newton's method ends after a step this short."""
MIN_DETERMINANT = 1e-3
"""The smallest determinant of undistortion's Jacobian that is inverted: the determinant goes
through zero next to the pixels whose rays do not leave the cover.
"""

Undistort = Callable[[Array, NDArray[np.intp]], tuple[Array, Array]]


@dataclass(frozen=True, slots=True)
class ForwardMap:
    """Undistortion at one depth, given at the nodes of a grid."""

    nodes_x: Array
    """(w,) distorted px, evenly spaced"""
    nodes_y: Array
    """(h,) distorted px, evenly spaced"""
    values: Array
    """(h, w, 2) px of the bare pinhole camera"""
    valid: Mask
    """(h, w), false where no ray leaves the cover; the values are extrapolated there."""

    @property
    def spline(self) -> Spline:
        """The spline from distorted px to px of the bare pinhole camera."""
        return Spline.through(self.nodes_x, self.nodes_y, self.values)

    def newton_starts(self, goal: Array) -> Array:
        """Return the (N, 2) distorted px at which Newton's method starts for (N, 2) undistorted px:
        the node with the nearest value among a subset of the valid nodes; the goal itself if no
        node of this subset is valid.
        """
        from scipy.spatial import KDTree  # most commands need no inverse

        stride = max(1, int(np.ceil(np.sqrt(self.valid.size / MAX_START_NODES))))
        subset = slice(stride // 2, None, stride)
        valid = self.valid[subset, subset]
        if not valid.any():
            return goal.copy()
        nodes = np.stack(np.meshgrid(self.nodes_x[subset], self.nodes_y[subset]), -1)[valid]
        return np.asarray(nodes[KDTree(self.values[subset, subset][valid]).query(goal)[1]])


@dataclass(frozen=True, slots=True)
class InverseMap:
    """The distorted pixels of a regular grid over the undistorted picture, at one depth."""

    columns: Array
    """(w,) px of the picture."""
    rows: Array
    """(h,) px"""
    nodes: Array
    """(h, w, 2) distorted px."""
    cells: Mask
    """(h - 1, w - 1) true where the spline through the nodes is the inverse between them."""

    @property
    def spline(self) -> Spline:
        """The spline from px of the picture to distorted px."""
        return Spline.through(self.columns, self.rows, self.nodes)


def invert(forward: ForwardMap, window: Window) -> InverseMap:
    """Solve on finer and finer grids, down to the spacing of `forward`, until the spline is the
    inverse between the nodes as well, or few pixels are left between two nodes.
    """
    for spacing in grid_spacings(min(SPACING, float(forward.nodes_x[1] - forward.nodes_x[0]))):
        columns = grid_nodes(window.width, spacing / window.zoom[0], 0.0)
        rows = grid_nodes(window.height, spacing / window.zoom[1], 0.0)
        inverse, solved = invert_on_grid(forward, window, columns, rows)
        few = FEW_PIXELS * len(columns) * len(rows) > window.width * window.height
        if inverse.cells.all() or (
            spacing <= SPACING and (few or inverse.cells[interior_cells(solved)].all())
        ):
            break
    return inverse


def invert_on_grid(
    forward: ForwardMap, window: Window, columns: Array, rows: Array
) -> tuple[InverseMap, Mask]:
    """Solve at the nodes of one grid.

    Args:
        columns: (w,) px of the picture.
        rows: (h,) px of the picture.

    Returns:
        The inverse, extrapolated to nodes that no distorted pixel sees, and (h - 1, w - 1) true for
        cells whose four nodes were solved.
    """
    spline = forward.spline
    goal = _goal(window, columns, rows)
    flat = goal.reshape(-1, 2)
    pixels, converged = solve_newton(
        lambda pixels, _: spline.at(pixels), forward.newton_starts(flat), flat
    )
    converged = converged.reshape(goal.shape[:2])
    solved = all_corners_true(converged)
    if not solved.any():
        return InverseMap(columns, rows, goal, solved), solved
    nodes = goal + extrapolate(pixels.reshape(goal.shape) - goal, converged)
    return (
        InverseMap(columns, rows, nodes, solved & _inverts(spline, window, columns, rows, nodes)),
        solved,
    )


def grid_spacings(finest: float) -> Iterator[float]:
    """Yield grid spacings, px, from coarse to fine.

    A grid coarser than SPACING is accepted only if nothing on it fails: it would place the border
    of the valid region too coarsely.
    """
    spacing = float(COARSEST)
    while spacing >= finest:
        yield spacing
        spacing /= 2


def solve_newton(
    undistort: Undistort, starts: Array, goal: Array, last: float = CONVERGED
) -> tuple[Array, Mask]:
    """Solve `undistort(pixels) = goal` for N points at once by Newton's method.

    Args:
        undistort: a function of (n, 2) distorted px and the (n,) indices of these points among the
            N; it returns (n, 2) undistorted px and their (n, 2, 2) Jacobians.
        starts: (N, 2) distorted px.
        goal: (N, 2) undistorted px.
        last: px: the method ends after a step this short. The remaining error is of the order of
            the step's square times the curvature.

    Returns:
        (N, 2) distorted px, and (N,) true where the method converged.
    """
    pixels = starts.copy()
    remaining = np.arange(len(goal))
    for _ in range(NEWTON_STEPS):
        reached, jacobian = undistort(pixels[remaining], remaining)
        step, folded = newton_step(reached - goal[remaining], jacobian)
        length = np.hypot(step[:, 0], step[:, 1])
        pixels[remaining] -= step * np.minimum(1, MAX_STEP / np.maximum(length, 1e-12))[:, None]
        remaining = remaining[folded | ~(length <= last)]
        if not len(remaining):
            break
    converged = np.ones(len(goal), dtype=bool)
    converged[remaining] = False
    return pixels, converged


def newton_step(error: Array, jacobian: Array) -> tuple[Array, Mask]:
    """Return the step of Newton's method, which the caller subtracts.

    Args:
        error: (N, 2) undistorted px minus the goal.
        jacobian: (N, 2, 2) of undistorted by distorted px.

    Returns:
        (N, 2) distorted px, and (N,) true where the Jacobian's determinant is below
        MIN_DETERMINANT: there the step is the error itself.
    """
    (a, b), (c, d) = jacobian[:, 0].T, jacobian[:, 1].T
    det = a * d - b * c
    folded = ~(det >= MIN_DETERMINANT)
    safe = np.where(folded, 1.0, det)
    x, y = error.T
    step = np.stack([(d * x - b * y) / safe, (a * y - c * x) / safe], -1)
    step[folded] = error[folded]
    return step, folded


def _goal(window: Window, columns: Array, rows: Array) -> Array:
    """Return the (h, w, 2) px of the bare pinhole camera at a grid of the window's px."""
    goal: Array = np.stack(np.meshgrid(columns, rows), -1) * window.zoom + window.corner
    return goal


def _inverts(forward: Spline, window: Window, columns: Array, rows: Array, nodes: Array) -> Mask:
    """Return (h - 1, w - 1), true where the spline through the (h, w, 2) distorted nodes is the
    inverse in the middle of the cell.
    """
    xs, ys = midpoints(columns), midpoints(rows)
    goal = _goal(window, xs, ys).reshape(-1, 2)
    reached, jacobian = forward.at(
        Spline.through(columns, rows, nodes).on_grid(xs, ys).reshape(-1, 2)
    )
    step, folded = newton_step(reached - goal, jacobian)
    return np.asarray(
        (~folded & (np.hypot(step[:, 0], step[:, 1]) < MAX_ERROR)).reshape(len(ys), len(xs))
    )
