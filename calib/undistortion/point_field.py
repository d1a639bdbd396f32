"""Fast rays of many pixels and pixels of many points, by the field of rays: to a thousandth of a
pixel, a million a second.

A pixel's ray is the line through its undistorted points at all depths (`ray_field`). A point's
pixel is the solution of Newton's method on the field. Its start is nearly right, because the
inverse, like undistortion itself, is almost a linear function of 1 / depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.parameter_names import CAMERA
from calib.undistortion.grids import Array, Mask, all_corners_true, cell_index
from calib.undistortion.inverse import invert_on_grid, solve_newton
from calib.undistortion.ray_field import RayField, ray_field
from calib.undistortion.spline import MIN_NODES, Spline
from calib.undistortion.window import Window

TOLERANCE = 2e-4
"""px: the largest error of the field's splines at a tenth of a metre in front of the camera."""
NEAR = 0.5
"""m: the slope of the starts over 1 / depth is taken between this depth and infinity."""
START_SPACING = 32.0
"""px between the nodes of the starts."""
MAX_SIDE = 4096
"""px: the largest side of the picture of starts. The plane of a wide lens may be far larger than
its picture.
"""
LAST_STEP = 0.1
"""px: Newton's method ends after a step this short. Undistortion's derivative changes by a few
thousandths a pixel, so the remaining error is of the order of 1e-5 px.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PointField:
    """The rays of pixels and the pixels of points, within the field."""

    field: RayField
    forward: Spline
    """The spline from px to A (px), B (px m) and the z coordinate (m) where the ray leaves the
    cover: five components.
    """
    start: Spline
    """The spline from undistorted px to starts of Newton's method: the distorted px at infinity,
    and its change per 1/m of inverse depth.
    """
    focal: Array
    """(2,) px: the focal lengths of the bare pinhole camera."""
    principal: Array
    """(2,) px: its principal point."""

    @staticmethod
    def of(path: Path, values: Values, width: int, height: int) -> PointField:
        field = ray_field(path, values, width, height, TOLERANCE)
        nodes = np.concatenate([field.at_infinity, field.parallax, field.nearest[..., None]], -1)
        forward = Spline.through(field.nodes_x, field.nodes_y, nodes)
        focal = np.array([float(values[name]) for name in CAMERA.focal])
        principal = np.array([float(values[name]) for name in CAMERA.centre])
        return PointField(field, forward, _start_spline(field), focal, principal)

    def rays(self, pixels: Array) -> tuple[Array, Array, Mask]:
        """Return for (N, 2) px the (N, 3) m points where their rays leave the cover, their (N, 3)
        unit directions, and (N,) true where the pixel is within the field.
        """
        in_field = self._contains(pixels)
        components = self.forward.values(
            pixels if in_field.all() else np.where(in_field[:, None], pixels, self.principal)
        )
        origins, directions = np.empty((2, len(pixels), 3))
        x = (components[:, 0] - self.principal[0]) / self.focal[0]
        y = (components[:, 1] - self.principal[1]) / self.focal[1]
        exit_z = components[:, 4]
        length = np.sqrt(1 + x * x + y * y)
        for axis, tangent in enumerate((x, y)):
            origins[:, axis] = tangent * exit_z + components[:, 2 + axis] / self.focal[axis]
            directions[:, axis] = tangent / length
        origins[:, 2], directions[:, 2] = exit_z, 1 / length
        return origins, directions, in_field

    def pixels(self, points: Array) -> tuple[Array, Mask]:
        """Return the (N, 2) px of (N, 3) m points in the camera frame, and (N,) true where the
        field holds them.
        """
        ahead = np.isfinite(points).all(1) & (points[:, 2] > self.field.nearest.max())
        inverse_depth = 1 / np.where(ahead, points[:, 2], 1.0)[:, None]
        goal = np.where(
            ahead[:, None],
            points[:, :2] * inverse_depth * self.focal + self.principal,
            self.principal,
        )
        start = self.start.values(goal)
        pixels, converged = solve_newton(
            lambda pixels, rows: self._undistort_with_jacobian(pixels, inverse_depth[rows]),
            start[:, :2] + inverse_depth * start[:, 2:],
            goal,
            LAST_STEP,
        )
        return pixels, ahead & converged & self._contains(pixels)

    def _undistort_with_jacobian(self, pixels: Array, inverse_depth: Array) -> tuple[Array, Array]:
        value, derivatives = self.forward.at(pixels)
        return (
            value[:, :2] + inverse_depth * value[:, 2:4],
            derivatives[:, :2] + inverse_depth[..., None] * derivatives[:, 2:4],
        )

    def _contains(self, pixels: Array) -> Mask:
        """Return (N,), true for px between four nodes whose rays leave the cover."""
        field = self.field
        x, y = pixels.T
        in_grid = (
            (x >= field.nodes_x[0])
            & (x <= field.nodes_x[-1])
            & (y >= field.nodes_y[0])
            & (y <= field.nodes_y[-1])
        )
        if field.valid.all():
            return np.asarray(in_grid)
        row = cell_index(np.where(in_grid, y, 0.0), field.nodes_y)
        column = cell_index(np.where(in_grid, x, 0.0), field.nodes_x)
        return np.asarray(in_grid & all_corners_true(field.valid)[row, column])


def _start_spline(field: RayField) -> Spline:
    """Return the spline of Newton's starts, the inverse at infinity and its change over 1 / depth,
    over all undistorted px that the field has at infinity or at NEAR.
    """
    pixels = np.concatenate(
        [
            (field.at_infinity + field.parallax * inverse_depth)[field.valid]
            for inverse_depth in (0.0, 1 / NEAR)
        ]
    )
    low, high = pixels.min(0), pixels.max(0)
    extent = np.ceil(high - low) + 1
    zoom = max(1.0, float(extent.max()) / MAX_SIDE)
    width = int(np.ceil(extent[0] / zoom))
    height = int(np.ceil(extent[1] / zoom))
    window = Window(width, height, (float(low[0]), float(low[1])), (zoom, zoom))
    columns = _start_nodes(width)
    rows = _start_nodes(height)
    far = invert_on_grid(field.forward(np.inf), window, columns, rows)[0].nodes
    close = invert_on_grid(field.forward(NEAR), window, columns, rows)[0].nodes
    return Spline.through(
        low[0] + zoom * columns,
        low[1] + zoom * rows,
        np.concatenate([far, (close - far) * NEAR], -1),
    )


def _start_nodes(side: int) -> Array:
    return np.linspace(0.0, side - 1, max(MIN_NODES, int(side / START_SPACING) + 1))
