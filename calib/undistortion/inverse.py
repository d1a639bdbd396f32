"""The inverse of the rays at one depth: which distorted pixel sees each undistorted one, on a grid fine enough for a spline."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calib.undistortion.grids import Array, Mask, all_corners, carried_on, grid, inner, middles
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

if TYPE_CHECKING:
    from calib.undistortion.ray_field import RayField

COARSEST = 64
"""px between nodes, where the field is smooth."""
SPACING = 16
"""px between nodes, at most, where some cannot be solved."""
ACCEPTED = 0.005
"""px: how far a spline may be off where refinement has stopped; what is further off counts as not valid."""
STARTS = 40_000
"""Nodes among which Newton's method seeks its start."""
NEWTON_STEPS = 15
LONGEST_STEP = 100.0
"""px"""
CONVERGED = 1e-6
"""px"""
FOLDED = 1e-3
"""The least determinant of the distortion's derivative: next to where no ray leaves the cover it goes through zero."""

Forward = Callable[[Array, NDArray[np.intp]], tuple[Array, Array]]


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
        """From undistorted to distorted px."""
        return Spline.through(self.columns, self.rows, self.nodes)


def invert(field: RayField, depth: float, window: Window) -> Inverse:
    """Solve on finer and finer grids, down to the field's own spacing, until the spline between the nodes is the inverse, too."""
    for spacing in spacings(min(SPACING, field.spacing)):
        columns, rows = (grid(size, spacing / zoom, 0.0) for size, zoom in zip((window.width, window.height), window.zoom, strict=True))
        inverse, sure = invert_on(field, depth, window, columns, rows)
        if inverse.cells.all() or (spacing <= SPACING and inverse.cells[inner(sure)].all()):
            break
    return inverse


def invert_on(field: RayField, depth: float, window: Window, columns: Array, rows: Array) -> tuple[Inverse, Mask]:
    """Solve for (w,) and (h,) nodes; and (h - 1, w - 1) between which four nodes the inverse exists. Elsewhere it is carried on."""
    forward = field.spline(depth)
    goal = _goal(window, columns, rows)
    found, held = solve(field, lambda pixels, _: forward.at(pixels), goal.reshape(-1, 2), depth)
    held = held.reshape(goal.shape[:2])
    sure = all_corners(held)
    if not sure.any():
        return Inverse(columns, rows, goal, sure), sure
    nodes = goal + carried_on(found.reshape(goal.shape) - goal, held)
    return Inverse(columns, rows, nodes, sure & _inverts(forward, window, columns, rows, nodes)), sure


def spacings(finest: float) -> Iterator[float]:
    """From coarse to fine. Above SPACING a grid will do only if nothing on it fails: it would draw the edge of what fails too coarsely."""
    spacing = float(COARSEST)
    while spacing >= finest:
        yield spacing
        spacing /= 2


def solve(field: RayField, forward: Forward, goal: Array, depth: float) -> tuple[Array, Mask]:
    """The (N, 2) distorted px of (N, 2) undistorted ones by Newton's method, and (N,) whether it converged.

    Args:
        forward: (n, 2) distorted px, and which of the N they are, to (n, 2) undistorted px and their (n, 2, 2) derivatives.
        depth: m, at which the start is sought.
    """
    found = _starts(field, goal, depth)
    still_open = np.arange(len(goal))
    for _ in range(NEWTON_STEPS):
        reached, slopes = forward(found[still_open], still_open)
        step, folded = newton_step(reached - goal[still_open], slopes)
        length = np.hypot(step[:, 0], step[:, 1])
        found[still_open] -= step * np.minimum(1, LONGEST_STEP / np.maximum(length, 1e-12))[:, None]
        still_open = still_open[folded | ~(length <= CONVERGED)]
        if not len(still_open):
            break
    converged = np.ones(len(goal), dtype=bool)
    converged[still_open] = False
    return found, converged


def newton_step(error: Array, slopes: Array) -> tuple[Array, Mask]:
    """(N, 2) px that (N, 2, 2) slopes ask for against (N, 2) errors, and (N,) where they fold: there it is the error itself."""
    (a, b), (c, d) = slopes[:, 0].T, slopes[:, 1].T
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


def _starts(field: RayField, goal: Array, depth: float) -> Array:
    """(N, 2) distorted px: for each undistorted one, the valid node that comes nearest to it."""
    every = max(1, int(np.ceil(np.sqrt(field.valid.size / STARTS))))
    some = slice(every // 2, None, every)
    valid = field.valid[some, some]
    if not valid.any():
        return goal.copy()
    nodes = np.stack(np.meshgrid(field.nodes_x[some], field.nodes_y[some]), -1)[valid]
    reached = (field.infinite[some, some] + field.parallax[some, some] / depth)[valid]
    return np.asarray(nodes[KDTree(reached).query(goal)[1]])


def _inverts(forward: Spline, window: Window, columns: Array, rows: Array, nodes: Array) -> Mask:
    """(h - 1, w - 1) whether the spline through the (h, w, 2) distorted nodes is the inverse between them as well."""
    across, down = middles(columns), middles(rows)
    goal = _goal(window, across, down).reshape(-1, 2)
    reached, slopes = forward.at(Spline.through(columns, rows, nodes).on_grid(across, down).reshape(-1, 2))
    off, folded = newton_step(reached - goal, slopes)
    return np.asarray((~folded & (np.hypot(off[:, 0], off[:, 1]) < ACCEPTED)).reshape(len(down), len(across)))
