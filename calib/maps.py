"""Undistortion maps for any depth, from one field of rays.

A pixel's ray leaves the cover at x_o along r_o, whatever the depth of what it meets. So the undistorted pixel at depth Z is exactly
p_u = A + B / Z with A = K r_o / r_oz and B = K' (x_o - r_o x_oz / r_oz), K' without the principal point (the paper's Fig. 8). A and
B are smooth: a coarse grid with cubic splines holds them, and the inverse that cv2.remap wants is solved on a coarse grid as well.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import BSpline, RectBivariateSpline, make_interp_spline
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from calib.errors import InputError
from calib.optics.params import Values
from calib.optics.path import Path

Array = NDArray[np.float64]

SPACING = 16
"""px between nodes, before refinement."""
FINEST = 4
TOLERANCE = 0.002
"""px: how far a spline may be from the traced rays. It leaves room for the second spline under the promised 0.01 px."""
MARGIN = 0.06
"""How far the nodes reach beyond the image, as a fraction of its side: a spline needs neighbours at the border."""
PROBES = 600
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
    """(h, w), false where no ray leaves the cover; A and B are carried on smoothly there."""

    def undistorted(self, pixels: Array, depth: float) -> Array:
        """(N, 2) distorted px to (N, 2) undistorted px at depth m."""
        return _at(self._splines(depth), self, pixels)[0]

    def map_at(self, depth: float) -> DepthMap:
        """The map of one depth, in m; infinity is a depth."""
        if not depth > 0:
            raise InputError(f"depth {depth:g} is not a distance in front of the camera: write metres above 0, such as 1.0.")
        splines = self._splines(depth)
        columns, rows = (_grid(size, self.spacing, 0.0) for size in (self.width, self.height))
        goal = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        found = self._inverse(splines, goal)
        nodes = found.reshape(len(rows), len(columns), 2)
        x, y = (_upsampled(rows, columns, nodes[..., i], self.height, self.width) for i in range(2))
        valid = (x >= -0.5) & (x <= self.width - 0.5) & (y >= -0.5) & (y <= self.height - 0.5) & self._seen(x, y)
        return DepthMap(depth, np.where(valid, x, np.float32(-1)), np.where(valid, y, np.float32(-1)), valid)

    def _inverse(self, splines: list[RectBivariateSpline], goal: Array) -> Array:
        """The (N, 2) distorted px of (N, 2) undistorted px, by Newton's method; any value where there is none."""
        found = goal.copy()
        open_rows = np.arange(len(goal))
        for _ in range(NEWTON_STEPS):
            reached, slopes = _at(splines, self, found[open_rows])
            folded = np.linalg.det(slopes) < 1e-3  # next to where no ray leaves the cover; such pixels come out as not valid
            slopes[folded] = np.eye(2)
            step = np.linalg.solve(slopes, (reached - goal[open_rows])[..., None])[..., 0]
            length = np.linalg.norm(step, axis=-1)
            found[open_rows] -= step * np.minimum(1, LONGEST_STEP / np.maximum(length, 1e-12))[:, None]
            open_rows = open_rows[length > CONVERGED]
            if not len(open_rows):
                break
        return found

    @property
    def spacing(self) -> float:
        """px between nodes."""
        return float(self.nodes_x[1] - self.nodes_x[0])

    def _splines(self, depth: float) -> list[RectBivariateSpline]:
        field = self.infinite + self.parallax / depth
        return [RectBivariateSpline(self.nodes_y, self.nodes_x, field[..., i]) for i in range(2)]

    def _seen(self, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(height, width) whether all rays near these distorted pixels leave the cover."""
        if self.valid.all():
            return np.ones(x.shape, dtype=bool)
        sure = distance_transform_edt(self.valid) > 2  # nodes: a spline leans on its neighbours
        column = np.clip(np.rint((x - self.nodes_x[0]) / self.spacing), 0, len(self.nodes_x) - 1).astype(np.intp)
        row = np.clip(np.rint((y - self.nodes_y[0]) / (self.nodes_y[1] - self.nodes_y[0])), 0, len(self.nodes_y) - 1).astype(np.intp)
        return np.asarray(sure[row, column])


def ray_field(path: Path, values: Values, width: int, height: int) -> RayField:
    """Trace the field, on a grid fine enough that its splines agree with tracing at random pixels."""
    probes = np.random.default_rng(0).uniform(0, 1, (PROBES, 2)) * [width - 1, height - 1]
    depth = 0.1  # m: nearer than a board can be held, so parallax counts in full
    infinite, parallax, arrived = _affine(path, values, torch.from_numpy(probes))
    truth = infinite + parallax / depth
    spacing = SPACING
    while True:
        columns, rows = (_grid(size, spacing, MARGIN * size) for size in (width, height))
        pixels = torch.from_numpy(np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2))
        infinite, parallax, ok = _affine(path, values, pixels)
        shape = len(rows), len(columns)
        valid = ok.reshape(shape)
        if not valid.any():
            raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
        at = pixels.numpy().reshape(*shape, 2)
        displacement = _carried_on(infinite.reshape(*shape, 2) - at, valid)
        field = RayField(width, height, columns, rows, at + displacement, _carried_on(parallax.reshape(*shape, 2), valid), valid)
        sure = arrived & field._seen(probes[:, 0].astype(np.float32), probes[:, 1].astype(np.float32))
        off = np.linalg.norm(field.undistorted(probes, depth) - truth, axis=-1)[sure]
        if off.size == 0 or off.max() < TOLERANCE or spacing <= FINEST:
            return field
        spacing //= 2


def _affine(path: Path, values: Values, pixels: Tensor) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A (N, 2) px and B (N, 2) px m of pixels (N, 2), and (N,) whether their rays go forward out of the cover."""
    rays = path.trace(pixels, values)
    ok = (rays.failure == 0) & (rays.direction.z > 1e-3)
    forward = torch.where(ok, rays.direction.z, torch.ones_like(rays.direction.z))
    tan_x, tan_y = rays.direction.x / forward, rays.direction.y / forward
    fx, fy, cx, cy = (values[f"camera.{name}"] for name in ("fx", "fy", "cx", "cy"))
    infinite = torch.stack([fx * tan_x + cx, fy * tan_y + cy], -1)
    parallax = torch.stack([fx * (rays.origin.x - tan_x * rays.origin.z), fy * (rays.origin.y - tan_y * rays.origin.z)], -1)
    return infinite.numpy(), parallax.numpy(), ok.numpy()


def _grid(size: int, spacing: float, margin: float) -> Array:
    """Evenly spaced nodes from -0.5 - margin to size - 0.5 + margin, about `spacing` apart and six at least."""
    count = max(6, int(np.ceil((size + 2 * margin) / spacing)) + 1)
    return np.linspace(-0.5 - margin, size - 0.5 + margin, count)


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
