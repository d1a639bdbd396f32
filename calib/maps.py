"""Undistortion maps for any depth, from one field of rays.

A pixel's ray leaves the cover at x_o along r_o, whatever the depth of what it meets. So the undistorted pixel at depth Z is exactly
p_u = A + B / Z with A = K r_o / r_oz and B = K' (x_o - r_o x_oz / r_oz), K' without the principal point (the paper's Fig. 8). A and
B are smooth: a coarse grid with cubic splines holds them, and the inverse that cv2.remap wants is solved on a coarse grid as well.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import BSpline, RectBivariateSpline, make_interp_spline
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from calib.errors import InputError
from calib.optics.params import Values
from calib.optics.path import Path

Array = NDArray[np.float64]

SPACING = 16
"""px between nodes, before refinement."""
FINEST = 2
MOST_NODES = 700_000
"""Refinement stops before it would take more."""
TOLERANCE = 0.002
"""px: how far a spline should be from the traced rays. It leaves room for the second spline under the promised 0.01 px."""
ACCEPTED = 0.005
"""px: how far it may be, where refinement has stopped; what is further off counts as not valid. Each of the two splines."""
CHECK_DEPTH = 0.1
"""m: where the splines are compared with rays. Nearer than a board can be held, so parallax counts in full."""
MARGIN = 0.06
"""How far the nodes reach beyond the image, as a fraction of its side: a spline needs neighbours at the border."""
NEAREST = 1e-3
"""m: the least depth of a map. Nearer, the point would lie in the lens or its cover, and parallax / depth loses its meaning."""
STARTS = 40_000
"""Nodes among which Newton's method seeks its start."""
CHUNK = 65_536
"""Rays traced at once: an uneven cover takes memory for every ray and bump."""
NEWTON_STEPS = 15
LONGEST_STEP = 100.0
"""px"""
CONVERGED = 1e-6
"""px"""


@dataclass(frozen=True, slots=True)
class DepthMap:
    """Where the distorted picture holds each undistorted pixel, for cv2.remap."""

    depth: float
    """m"""
    x: NDArray[np.float32]
    """(height, width) px; -1 where not valid."""
    y: NDArray[np.float32]
    valid: NDArray[np.bool_]
    """(height, width), false where the camera does not see that direction through its cover."""


@dataclass(frozen=True, slots=True)
class RayField:
    """A and B on a grid of distorted pixels."""

    width: int
    height: int
    nodes_x: Array
    """(w,) px"""
    nodes_y: Array
    """(h,) px"""
    infinite: Array
    """(h, w, 2) px, A: the undistorted pixel at infinite depth."""
    parallax: Array
    """(h, w, 2) px m, B: what is added for each 1/m of inverse depth."""
    valid: NDArray[np.bool_]
    """(h, w), false where no ray leaves the cover, or where the lens or cover bends so sharply that the nodes do not hold it. A and B are
    carried on there. Between four valid nodes, the splines are true."""

    def undistorted(self, pixels: Array, depth: float) -> Array:
        """(N, 2) distorted px to (N, 2) undistorted px at depth m."""
        return _at(self._splines(depth), self, pixels)[0]

    def map_at(self, depth: float) -> DepthMap:
        """The map of one depth, in m; infinity is a depth."""
        if not depth > 0:
            raise InputError(f"depth {depth:g} is not a distance in front of the camera: write metres above 0, such as 1.0.")
        if depth < NEAREST:
            raise InputError(f"depth {depth:g} m is too near: write metres from {NEAREST:g} on, beyond the cover, such as 1.0.")
        splines = self._splines(depth)
        spacing = max(SPACING, self.spacing)
        while True:
            columns, rows = (_grid(size, spacing, 0.0) for size in (self.width, self.height))
            goal = np.stack(np.meshgrid(columns, rows), -1)
            found, held = self._inverse(splines, goal, depth)
            if not held.any():
                nothing = np.full((self.height, self.width), np.float32(-1))
                return DepthMap(depth, nothing, nothing.copy(), np.zeros(nothing.shape, dtype=bool))
            nodes = goal + _carried_on(found - goal, held)
            sure, inverts = _all_corners(held), self._inverts(splines, columns, rows, nodes)
            if inverts[_inner(sure)].all() or spacing / 2 < self.spacing:
                break
            spacing /= 2
        x, y = (_upsampled(rows, columns, nodes[..., i], self.height, self.width) for i in range(2))
        valid = (x >= -0.5) & (x <= self.width - 0.5) & (y >= -0.5) & (y <= self.height - 0.5)
        cells = sure & inverts
        if not cells.all():
            cell_column, cell_row = (_cell(np.arange(size), nodes) for size, nodes in ((self.width, columns), (self.height, rows)))
            valid &= cells[np.ix_(cell_row, cell_column)]
        if not self.valid.all():
            valid &= _all_corners(self.valid)[_cell(y, self.nodes_y), _cell(x, self.nodes_x)]
        return DepthMap(depth, np.where(valid, x, np.float32(-1)), np.where(valid, y, np.float32(-1)), valid)

    def _inverse(self, splines: list[RectBivariateSpline], goal: Array, depth: float) -> tuple[Array, NDArray[np.bool_]]:
        """The (h, w, 2) distorted px of (h, w, 2) undistorted px by Newton's method, and (h, w) whether it converged."""
        shape = goal.shape
        goal = goal.reshape(-1, 2)
        found = self._starts(goal, depth)
        open_rows = np.arange(len(goal))
        for _ in range(NEWTON_STEPS):
            reached, slopes = _at(splines, self, found[open_rows])
            folded = np.linalg.det(slopes) < 1e-3  # next to where no ray leaves the cover
            slopes[folded] = np.eye(2)
            step = np.linalg.solve(slopes, (reached - goal[open_rows])[..., None])[..., 0]
            length = np.linalg.norm(step, axis=-1)
            found[open_rows] -= step * np.minimum(1, LONGEST_STEP / np.maximum(length, 1e-12))[:, None]
            open_rows = open_rows[folded | ~(length <= CONVERGED)]
            if not len(open_rows):
                break
        converged = np.ones(len(goal), dtype=bool)
        converged[open_rows] = False
        return found.reshape(shape), converged.reshape(shape[:2])

    def _starts(self, goal: Array, depth: float) -> Array:
        """(N, 2) distorted px: for each undistorted one, the valid node that comes nearest to it."""
        every = max(1, int(np.ceil(np.sqrt(self.valid.size / STARTS))))
        some = slice(every // 2, None, every)
        valid = self.valid[some, some]
        if not valid.any():
            return goal.copy()
        nodes = np.stack(np.meshgrid(self.nodes_x[some], self.nodes_y[some]), -1)[valid]
        reached = (self.infinite[some, some] + self.parallax[some, some] / depth)[valid]
        return np.asarray(nodes[KDTree(reached).query(goal)[1]])

    def _inverts(self, splines: list[RectBivariateSpline], columns: Array, rows: Array, nodes: Array) -> NDArray[np.bool_]:
        """(h - 1, w - 1) whether the spline through the (h, w, 2) distorted nodes is the inverse between them as well."""
        middles, levels = _middles(columns), _middles(rows)
        goal = np.stack(np.meshgrid(middles, levels), -1).reshape(-1, 2)
        pixels = np.stack([RectBivariateSpline(rows, columns, nodes[..., i])(levels, middles).ravel() for i in range(2)], -1)
        reached, slopes = _at(splines, self, pixels)
        folded = np.linalg.det(slopes) < 1e-3
        slopes[folded] = np.eye(2)
        off = np.linalg.norm(np.linalg.solve(slopes, (reached - goal)[..., None])[..., 0], axis=-1)
        return np.asarray((~folded & (off < ACCEPTED)).reshape(len(levels), len(middles)))

    @property
    def spacing(self) -> float:
        """px between nodes."""
        return float(self.nodes_x[1] - self.nodes_x[0])

    def _splines(self, depth: float) -> list[RectBivariateSpline]:
        field = self.infinite + self.parallax / depth
        return [RectBivariateSpline(self.nodes_y, self.nodes_x, field[..., i]) for i in range(2)]


def ray_field(path: Path, values: Values, width: int, height: int) -> RayField:
    """Trace the field, on a grid fine enough that between its nodes, too, its splines agree with tracing."""
    spacing = SPACING
    while True:
        columns, rows = (_grid(size, spacing, MARGIN * size) for size in (width, height))
        at, infinite, parallax, ok = _affine(path, values, columns, rows)
        if not ok.any():
            raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
        displacement = _carried_on(infinite - at, ok)
        field = RayField(width, height, columns, rows, at + displacement, _carried_on(parallax, ok), ok)
        between, infinite, parallax, arrived = _affine(path, values, _middles(columns), _middles(rows))
        off = np.linalg.norm(
            field.undistorted(between.reshape(-1, 2), CHECK_DEPTH).reshape(infinite.shape) - infinite - parallax / CHECK_DEPTH, axis=-1
        )
        sure = _all_corners(ok) & arrived
        seen = (np.abs(between - [(width - 1) / 2, (height - 1) / 2]) <= [width / 2, height / 2]).all(-1)
        fine = spacing // 2 < FINEST or 4 * len(columns) * len(rows) > MOST_NODES
        if fine or off[_inner(sure) & seen].max(initial=0) < TOLERANCE:
            bad = np.pad(~(sure & (off < ACCEPTED)), 1)
            touched = bad[1:, 1:] | bad[1:, :-1] | bad[:-1, 1:] | bad[:-1, :-1]
            return replace(field, valid=ok & ~touched)
        spacing //= 2


def _affine(path: Path, values: Values, columns: Array, rows: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """The (h, w, 2) px of a grid, their A (h, w, 2) px and B (h, w, 2) px m, and (h, w) whether their rays go forward out of the cover."""
    at = np.stack(np.meshgrid(columns, rows), -1)
    fx, fy, cx, cy = (values[f"camera.{name}"] for name in ("fx", "fy", "cx", "cy"))
    chunks = []
    for first in range(0, len(columns) * len(rows), CHUNK):
        rays = path.trace(torch.from_numpy(at.reshape(-1, 2)[first : first + CHUNK]), values)
        ok = (rays.failure == 0) & (rays.direction.z > 1e-3)
        forward = torch.where(ok, rays.direction.z, torch.ones_like(rays.direction.z))
        tan_x, tan_y = rays.direction.x / forward, rays.direction.y / forward
        infinite = torch.stack([fx * tan_x + cx, fy * tan_y + cy], -1)
        parallax = torch.stack([fx * (rays.origin.x - tan_x * rays.origin.z), fy * (rays.origin.y - tan_y * rays.origin.z)], -1)
        chunks.append((infinite, parallax, ok))
    infinite, parallax, ok = (torch.cat(parts) for parts in zip(*chunks, strict=True))
    return at, infinite.reshape(at.shape).numpy(), parallax.reshape(at.shape).numpy(), ok.reshape(at.shape[:2]).numpy()


def _grid(size: int, spacing: float, margin: float) -> Array:
    """Evenly spaced nodes from -0.5 - margin to size - 0.5 + margin, about `spacing` apart and six at least."""
    count = max(6, int(np.ceil((size + 2 * margin) / spacing)) + 1)
    return np.linspace(-0.5 - margin, size - 0.5 + margin, count)


def _middles(nodes: Array) -> Array:
    return np.asarray((nodes[1:] + nodes[:-1]) / 2)


def _cell(at: NDArray[np.generic], nodes: Array) -> NDArray[np.intp]:
    """Between which two of the evenly spaced nodes each coordinate lies: the index of the first."""
    return np.asarray(np.clip((at - nodes[0]) / (nodes[1] - nodes[0]), 0, len(nodes) - 2).astype(np.intp))


def _all_corners(nodes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(h - 1, w - 1) whether all four nodes around a cell are true."""
    return nodes[1:, 1:] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[:-1, :-1]


def _inner(sure: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What is further than two cells from any that is not sure: finer nodes would not help there."""
    return sure if sure.all() else np.asarray(distance_transform_edt(sure) > 2)


def _carried_on(field: Array, valid: NDArray[np.bool_]) -> Array:
    """The field with what is not valid replaced by its nearest valid neighbour's value."""
    if valid.all():
        return field
    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(field[tuple(nearest)])


def _at(splines: list[RectBivariateSpline], field: RayField, pixels: Array) -> tuple[Array, Array]:
    """The (N, 2) value and (N, 2, 2) derivative at (N, 2) px; beyond the nodes, linear."""
    inside = np.clip(pixels, [field.nodes_x[0], field.nodes_y[0]], [field.nodes_x[-1], field.nodes_y[-1]])
    x, y = inside[:, 0], inside[:, 1]
    value = np.stack([s.ev(y, x) for s in splines], -1)
    slopes = np.stack([np.stack([s.ev(y, x, dy=1), s.ev(y, x, dx=1)], -1) for s in splines], -2)
    return value + (slopes @ (pixels - inside)[..., None])[..., 0], slopes


def _upsampled(rows: Array, columns: Array, values: Array, height: int, width: int) -> NDArray[np.float32]:
    """Cubic spline interpolation of (h, w) node values at every pixel: (height, width)."""
    down = make_interp_spline(rows, values, k=3)  # coefficients (h, w)
    across = make_interp_spline(columns, np.asarray(down.c).T, k=3)  # coefficients (w, h)
    to_rows = BSpline.design_matrix(np.arange(height, dtype=np.float64), down.t, 3)
    to_columns = BSpline.design_matrix(np.arange(width, dtype=np.float64), across.t, 3)
    narrow = to_rows @ np.asarray(across.c).T  # (height, w)
    full = np.empty((height, width), dtype=np.float32)
    for first in range(0, height, 256):  # strips keep the float64 intermediate small
        full[first : first + 256] = np.asarray(to_columns @ narrow[first : first + 256].T).T
    return full
