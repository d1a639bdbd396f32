"""Many rays, and many points' pixels, through the field of rays: to a thousandth of a pixel, a
million a second.

A ray is where the field says that its pixel's point is at every depth (`ray_field`). A point's
pixel is found by Newton's method on the
field, from a start that is nearly right: the inverse is almost a straight line in 1 / depth, as
    undistortion is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.optics.params import Values
from calib.optics.path import Path
from calib.undistortion.grids import Array, Mask, all_corners, cell
from calib.undistortion.inverse import invert_on, solve
from calib.undistortion.ray_field import RayField, ray_field
from calib.undistortion.spline import FEWEST, Spline
from calib.undistortion.window import Window

TOLERANCE = 2e-4
"""px: how far the field's splines may be off, a tenth of a metre in front of the camera."""
NEAR = 0.5
"""m: the depth that gives the starts their slope over 1 / depth."""
START = 32.0
"""px between the nodes of the starts."""
LARGEST = 4096
"""px: a wide lens's plane may be far larger than its picture."""
LAST = 0.1
"""px: a step of Newton's method after which no other is needed: undistortion's derivative changes
by a few thousandths a pixel, so what is left is of the order of 1e-5 px.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PointField:
    """Rays by pixels and pixels by points, where the field holds them."""

    field: RayField
    forward: Spline
    """From px to A (px), B (px m) and how far in front of the camera the ray leaves the cover (m):
    five components.
    """
    back: Spline
    """From undistorted px to the px that sees them at infinity, and what is added for each 1/m."""
    focal: Array
    """(2,) px, of the bare pinhole camera, and its principal point."""
    principal: Array

    @staticmethod
    def of(path: Path, values: Values, width: int, height: int) -> PointField:
        field = ray_field(path, values, width, height, TOLERANCE)
        nodes = np.concatenate([field.at_infinity, field.parallax, field.nearest[..., None]], -1)
        forward = Spline.through(field.nodes_x, field.nodes_y, nodes)
        fx, fy, cx, cy = (float(values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy"))
        return PointField(field, forward, _back(field), np.array([fx, fy]), np.array([cx, cy]))

    def rays(self, pixels: Array) -> tuple[Array, Array, Mask]:
        """(N, 2) px to (N, 3) m where each ray leaves the cover, (N, 3) unit where it goes, and
        (N,) whether the field holds it.
        """
        held = self._holds(pixels)
        found = self.forward.values(
            pixels if held.all() else np.where(held[:, None], pixels, self.principal)
        )
        origins, directions = np.empty((2, len(pixels), 3))
        (x, y), ahead = (
            ((found[:, axis] - self.principal[axis]) / self.focal[axis] for axis in (0, 1)),
            found[:, 4],
        )
        length = np.sqrt(1 + x * x + y * y)
        for axis, tangent in enumerate((x, y)):
            origins[:, axis] = tangent * ahead + found[:, 2 + axis] / self.focal[axis]
            directions[:, axis] = tangent / length
        origins[:, 2], directions[:, 2] = ahead, 1 / length
        return origins, directions, held

    def pixels(self, points: Array) -> tuple[Array, Mask]:
        """(N, 3) m in the camera frame to (N, 2) px, and (N,) whether the field holds them."""
        ahead = np.isfinite(points).all(1) & (points[:, 2] > self.field.nearest.max())
        near = 1 / np.where(ahead, points[:, 2], 1.0)[:, None]
        goal = np.where(
            ahead[:, None], points[:, :2] * near * self.focal + self.principal, self.principal
        )
        far = self.back.values(goal)
        found, converged = solve(
            lambda some, rows: self._undistorted(some, near[rows]),
            far[:, :2] + near * far[:, 2:],
            goal,
            LAST,
        )
        return found, ahead & converged & self._holds(found)

    def _undistorted(self, pixels: Array, near: Array) -> tuple[Array, Array]:
        value, derivatives = self.forward.at(pixels)
        return (
            value[:, :2] + near * value[:, 2:4],
            derivatives[:, :2] + near[..., None] * derivatives[:, 2:4],
        )

    def _holds(self, pixels: Array) -> Mask:
        """(N,) whether px lie between four nodes whose rays leave the cover."""
        field = self.field
        x, y = pixels.T
        within = (
            (x >= field.nodes_x[0])
            & (x <= field.nodes_x[-1])
            & (y >= field.nodes_y[0])
            & (y <= field.nodes_y[-1])
        )
        if field.valid.all():
            return np.asarray(within)
        at = (
            cell(np.where(within, y, 0.0), field.nodes_y),
            cell(np.where(within, x, 0.0), field.nodes_x),
        )
        return np.asarray(within & all_corners(field.valid)[at])


def _back(field: RayField) -> Spline:
    """Where to begin: the inverse at infinity, and its change over 1 / depth, over all that the
    field sees at either.
    """
    both = np.concatenate(
        [(field.at_infinity + field.parallax * near)[field.valid] for near in (0.0, 1 / NEAR)]
    )
    low, high = both.min(0), both.max(0)
    extent = np.ceil(high - low) + 1
    zoom = max(1.0, float(extent.max()) / LARGEST)
    width, height = (int(np.ceil(side / zoom)) for side in extent)
    window = Window(width, height, (float(low[0]), float(low[1])), (zoom, zoom))
    columns, rows = (
        np.linspace(0.0, side - 1, max(FEWEST, int(side / START) + 1)) for side in (width, height)
    )
    far, close = (
        invert_on(field.forward(depth), window, columns, rows)[0].nodes for depth in (np.inf, NEAR)
    )
    return Spline.through(
        low[0] + zoom * columns,
        low[1] + zoom * rows,
        np.concatenate([far, (close - far) * NEAR], -1),
    )
