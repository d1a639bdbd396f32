"""Undistortion maps for any depth, from one field of rays.

A pixel's ray leaves the cover at x_o along r_o, whatever the depth of what it meets. So the
undistorted pixel at depth Z is exactly p_u = A + B / Z with A = K r_o / r_oz and B = K' (x_o - r_o
x_oz / r_oz), K' without the principal point (the paper's Fig. 8). A and
B are smooth: a coarse grid with cubic splines holds them, and the inverse that cv2.remap wants is
    solved on a coarse grid as well.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from calib.errors import InputError
from calib.optics.params import Values
from calib.optics.path import Path
from calib.undistortion.depth_map import DepthMap, depth_map
from calib.undistortion.grids import (
    Array,
    Mask,
    all_corners,
    cell,
    extrapolated,
    grid,
    inner,
    middles,
)
from calib.undistortion.inverse import ACCEPTED, SPACING, Forward, invert, solve, spacings
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

FINEST = 2
MOST_NODES = 700_000
"""Refinement stops before it would take more."""
TOLERANCE = 0.002
"""px: how far a spline should be from the traced rays.

It leaves room for the second spline under the promised 0.01 px.
"""
CHECK_DEPTH = 0.1
"""m: where the splines are compared with rays.

Nearer than a board can be held, so parallax counts in full.
"""
MARGIN = 0.06
"""How far the nodes reach beyond the image, as a fraction of its side: a spline needs neighbours at
the border.
"""
NEAREST = 1e-3
"""m: the least depth of a map.

Nearer, the point would lie in the lens or its cover, and parallax / depth loses its meaning.
"""
CHUNK = 65_536
"""Rays traced at once: an uneven cover takes memory for every ray and bump."""


@dataclass(frozen=True)
class RayField:
    """A and B on a grid of distorted pixels."""

    width: int
    height: int
    nodes_x: Array
    """(w,) px"""
    nodes_y: Array
    """(h,) px"""
    at_infinity: Array
    """(h, w, 2) px, A: the undistorted pixel at infinite depth."""
    parallax: Array
    """(h, w, 2) px m, B: what is added for each 1/m of inverse depth."""
    valid: Mask
    """(h, w), false where no ray leaves the cover or it does not go forward, and where the lens or
    cover bends so sharply that the nodes do not hold it. A and B are extrapolated there. Between
    four valid nodes, the splines are true.
    """

    nearest: Array
    """(h, w) m: how far in front of the camera its ray leaves the cover. It sees nothing nearer."""

    @property
    def window(self) -> Window:
        """The picture of the bare pinhole camera."""
        return Window(self.width, self.height)

    def forward(self, depth: float) -> Forward:
        """From distorted to undistorted px at depth m, at the nodes and between them; infinity is a
        depth.
        """
        return Forward(
            self.nodes_x, self.nodes_y, self.at_infinity + self.parallax / depth, self.valid
        )

    def spline(self, depth: float) -> Spline:
        """From distorted to undistorted px at depth m."""
        return self.forward(depth).spline

    def undistorted(self, pixels: Array, depth: float | Array) -> Array:
        """(N, 2) distorted px to (N, 2) undistorted px at depth m, one for all or (N,)."""
        return self._undistort(pixels, depth)[0]

    def distorted(self, pixels: Array, depth: float | Array) -> tuple[Array, Mask]:
        """(N, 2) undistorted px at depth m, one for all or (N,), to (N, 2) distorted px, and (N,)
        whether the camera sees them.
        """
        each = np.broadcast_to(np.asarray(depth, dtype=np.float64), len(pixels))
        starts = self.forward(float(np.median(each)) if len(each) else np.inf).starts(pixels)
        found, converged = solve(
            lambda some, rows: self._undistort(some, each[rows]), starts, pixels
        )
        return found, converged & self.sees(found[:, 0], found[:, 1], each)

    def sees(
        self, x: NDArray[np.floating], y: NDArray[np.floating], depth: float | NDArray[np.floating]
    ) -> Mask:
        """(...) whether distorted px lie on the image, see through the cover, and see as near as
        depth m.
        """
        seen = (x >= -0.5) & (x <= self.width - 0.5) & (y >= -0.5) & (y <= self.height - 0.5)
        near = bool((np.asarray(depth) <= self.nearest.max()).any())
        if near or not self.valid.all():
            column, row = cell(x, self.nodes_x), cell(y, self.nodes_y)
            seen &= all_corners(self.valid)[row, column]
            if near:
                out = sliding_window_view(self.nearest, (2, 2)).max((2, 3))
                seen &= depth > out[row, column]
        return seen

    def holds(self, pixels: Array) -> Mask:
        """Return (N,), true where the undistorted picture shows what (N, 2) distorted px see far
        away. It is a pinhole's picture, which ends before 90 degrees from the axis.
        """
        far = self.undistorted(pixels, np.inf)
        within = ((far >= -0.5) & (far <= [self.width - 0.5, self.height - 0.5])).all(-1)
        return np.asarray(within & self.sees(pixels[:, 0], pixels[:, 1], np.inf))

    def map_at(self, depth: float, window: Window | None = None) -> DepthMap:
        """The map of one depth, in m; infinity is a depth.

        By default, of the picture that the bare pinhole camera takes.
        """
        check_depth(depth)
        window = window or self.window
        return depth_map(invert(self.forward(depth), window), depth, window, self.sees)

    @cached_property
    def _both(self) -> Spline:
        """A and B, four components."""
        return Spline.through(
            self.nodes_x, self.nodes_y, np.concatenate([self.at_infinity, self.parallax], -1)
        )

    def _undistort(self, pixels: Array, depth: float | Array) -> tuple[Array, Array]:
        """(N, 2) undistorted px and their (N, 2, 2) Jacobians by (N, 2) distorted px, at depth m,
        one for all or (N,).
        """
        value, derivatives = self._both.at(pixels)
        near = 1 / np.broadcast_to(np.asarray(depth, dtype=np.float64), len(pixels))  # 1/m
        return (
            value[:, :2] + near[:, None] * value[:, 2:],
            derivatives[:, :2] + near[:, None, None] * derivatives[:, 2:],
        )


def check_depth(depth: float) -> None:
    """Refuse what is not a distance of something that the camera can see."""
    if not depth > 0:
        raise InputError(
            f"depth {depth:g} is not a distance in front of the camera: write metres above 0, such"
            " as 1.0."
        )
    if depth < NEAREST:
        raise InputError(
            f"depth {depth:g} m is too near: write metres from {NEAREST:g} on, beyond the cover,"
            " such as 1.0."
        )


def ray_field(
    path: Path, values: Values, width: int, height: int, tolerance: float = TOLERANCE
) -> RayField:
    """Trace the field, on a grid fine enough that between its nodes, too, its splines agree with
    tracing, to `tolerance` px.
    """
    for spacing in spacings(FINEST):
        columns, rows = (grid(size, spacing, MARGIN * size) for size in (width, height))
        at, at_infinity, parallax, nearest, ok = _affine(path, values, columns, rows)
        if spacing == SPACING and not ok.any():
            raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
        if spacing > SPACING and not ok.all():
            continue
        displacement = extrapolated(at_infinity - at, ok)
        field = RayField(
            width,
            height,
            columns,
            rows,
            at + displacement,
            extrapolated(parallax, ok),
            ok,
            extrapolated(nearest, ok),
        )
        between, at_infinity, parallax, _, arrived = _affine(
            path, values, middles(columns), middles(rows)
        )
        off = np.linalg.norm(
            field.undistorted(between.reshape(-1, 2), CHECK_DEPTH).reshape(at_infinity.shape)
            - at_infinity
            - parallax / CHECK_DEPTH,
            axis=-1,
        )
        sure = all_corners(ok) & arrived
        good = sure & (off < ACCEPTED)
        seen = (
            np.abs(between - [(width - 1) / 2, (height - 1) / 2]) <= [width / 2, height / 2]
        ).all(-1)
        if off[inner(sure) & seen].max(initial=0) < tolerance and (
            spacing <= SPACING or good.all()
        ):
            break
        if 4 * len(columns) * len(rows) > MOST_NODES:
            break
    bad = np.pad(~good, 1)
    touched = bad[1:, 1:] | bad[1:, :-1] | bad[:-1, 1:] | bad[:-1, :-1]
    return replace(field, valid=ok & ~touched)


def _affine(
    path: Path, values: Values, columns: Array, rows: Array
) -> tuple[Array, Array, Array, Array, Mask]:
    """The (h, w, 2) px of a grid, their A (h, w, 2) px and B (h, w, 2) px m, the (h, w) m in front
    of the camera where their rays leave the cover, and (h, w) whether they go forward out of it.
    """
    at = np.stack(np.meshgrid(columns, rows), -1)
    fx, fy, cx, cy = (values[f"camera.{name}"] for name in ("fx", "fy", "cx", "cy"))
    chunks = []
    for first in range(0, len(columns) * len(rows), CHUNK):
        rays = path.trace(torch.from_numpy(at.reshape(-1, 2)[first : first + CHUNK]), values)
        ok = rays.in_pinhole
        forward = torch.where(ok, rays.direction.z, torch.ones_like(rays.direction.z))
        tan_x, tan_y = rays.direction.x / forward, rays.direction.y / forward
        at_infinity = torch.stack([fx * tan_x + cx, fy * tan_y + cy], -1)
        parallax = torch.stack(
            [
                fx * (rays.origin.x - tan_x * rays.origin.z),
                fy * (rays.origin.y - tan_y * rays.origin.z),
            ],
            -1,
        )
        chunks.append((at_infinity, parallax, rays.origin.z, ok))
    shape = at.shape[:2]
    a, b, nearest, arrived = (torch.cat(parts).numpy() for parts in zip(*chunks, strict=True))
    return (
        at,
        a.reshape(at.shape),
        b.reshape(at.shape),
        nearest.reshape(shape),
        arrived.reshape(shape),
    )
