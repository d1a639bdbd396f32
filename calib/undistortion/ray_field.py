"""Undistortion maps for any depth, from one field of rays.

A pixel's ray leaves the cover at x_o along r_o, at whatever depth it meets an object. So the
undistorted pixel at depth Z is exactly p_u = A + B / Z with A = K r_o / r_oz and B = K' (x_o - r_o
x_oz / r_oz), K' without the principal point (the paper's Fig. 8). A and B are smooth: cubic splines
on a coarse grid hold them. The inverse that cv2.remap needs is solved on a coarse grid as well.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from calib.errors import InputError
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.parameter_names import CAMERA
from calib.undistortion.depth_map import DepthMap, depth_map
from calib.undistortion.grids import (
    Array,
    Mask,
    all_corners_true,
    cell_index,
    extrapolate,
    grid_nodes,
    interior_cells,
    midpoints,
)
from calib.undistortion.inverse import (
    MAX_ERROR,
    SPACING,
    ForwardMap,
    InverseMap,
    grid_spacings,
    invert,
    solve_newton,
)
from calib.undistortion.spline import Spline
from calib.undistortion.window import Window

FINEST = 2
MAX_NODES = 700_000
"""Refinement stops before a grid would have more nodes."""
TOLERANCE = 0.002
"""px: the largest difference between a spline and the traced rays.

It leaves room for the error of the second spline within the promised 0.01 px.
"""
CHECK_DEPTH = 0.1
"""m: the depth at which the splines are compared with rays.

A board cannot be held so near, so parallax counts in full.
"""
MARGIN = 0.06
"""The margin of the nodes around the image, as a fraction of its side: a spline needs neighbours at
the border.
"""
BORDER = 3.0
"""Steps of the grid between what the camera sees and the nearest node that is not valid. The
splines need one. At three the border is smooth, where the cells themselves would notch it.
"""
MIN_DEPTH = 1e-3
"""m: the smallest depth of a map.

A nearer point would lie in the lens or its cover, and parallax / depth loses its meaning.
"""
BATCH_SIZE = 65_536
"""The number of rays traced together: an uneven cover takes memory for every ray and bump."""


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
    """(h, w, 2) px m, B: the shift of the undistorted pixel per 1/m of inverse depth."""
    valid: Mask
    """(h, w), false where no ray leaves the cover, where it does not go forward, or where the lens
    or cover bends so sharply that the splines are not accurate. A and B are extrapolated there.
    Between four valid nodes, the splines are accurate.
    """

    nearest: Array
    """(h, w) m: the z coordinate where the ray leaves the cover. A pixel sees nothing nearer."""

    @property
    def window(self) -> Window:
        """The picture of the bare pinhole camera."""
        return Window(self.width, self.height)

    def forward(self, depth: float) -> ForwardMap:
        """Return undistortion at a depth in m, which may be infinite."""
        return ForwardMap(
            self.nodes_x, self.nodes_y, self.at_infinity + self.parallax / depth, self.valid
        )

    def spline(self, depth: float) -> Spline:
        """Return the spline from distorted to undistorted px at a depth in m."""
        return self.forward(depth).spline

    def undistort_pixels(self, pixels: Array, depth: float | Array) -> Array:
        """Return the (N, 2) undistorted px of (N, 2) distorted px at a depth in m, one for all or
        (N,).
        """
        return self._undistort_with_jacobian(pixels, depth)[0]

    def distort_pixels(self, pixels: Array, depth: float | Array) -> tuple[Array, Mask]:
        """Return the (N, 2) distorted px of (N, 2) undistorted px at a depth in m, one for all or
        (N,), and (N,) true where the camera sees the point.
        """
        depths = np.broadcast_to(np.asarray(depth, dtype=np.float64), len(pixels))
        median = float(np.median(depths)) if len(depths) else np.inf
        starts = self.forward(median).newton_starts(pixels)
        distorted, converged = solve_newton(
            lambda subset, rows: self._undistort_with_jacobian(subset, depths[rows]),
            starts,
            pixels,
        )
        return distorted, converged & self.sees(distorted[:, 0], distorted[:, 1], depths)

    def sees(
        self, x: NDArray[np.floating], y: NDArray[np.floating], depth: float | NDArray[np.floating]
    ) -> Mask:
        """Return (...), true for distorted px on the image whose rays leave the cover at a smaller
        depth than `depth`, m.
        """
        visible = (x >= -0.5) & (x <= self.width - 0.5) & (y >= -0.5) & (y <= self.height - 0.5)
        if not self.valid.all():
            visible &= self._steps_to_border(x, y) >= BORDER
        if bool((np.asarray(depth) <= self.nearest.max()).any()):
            column, row = cell_index(x, self.nodes_x), cell_index(y, self.nodes_y)
            exit_depth = sliding_window_view(self.nearest, (2, 2)).max((2, 3))
            visible &= depth > exit_depth[row, column]
        return visible

    def _steps_to_border(
        self, x: NDArray[np.floating], y: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Return the (...) distances of distorted px from the nearest node that is not valid, in
        steps of the grid.
        """
        import cv2  # most covers do not need it

        from calib.undistortion.remap import remap

        column = np.asarray((x - self.nodes_x[0]) / (self.nodes_x[1] - self.nodes_x[0]), np.float32)
        row = np.asarray((y - self.nodes_y[0]) / (self.nodes_y[1] - self.nodes_y[0]), np.float32)
        if not column.size:
            return column
        shape = (-1, column.shape[-1]) if column.ndim else (1, 1)
        steps = remap(
            self._steps_of_nodes,
            column.reshape(shape),
            row.reshape(shape),
            cv2.INTER_LINEAR,
            cv2.BORDER_REPLICATE,
        )
        return steps.reshape(column.shape)

    @cached_property
    def _steps_of_nodes(self) -> NDArray[np.float32]:
        """The (h, w) smoothed distances of the nodes from the nearest that is not valid, in steps,
        below BORDER where one of the eight neighbours is not valid.
        """
        from scipy.ndimage import distance_transform_edt, gaussian_filter

        steps = distance_transform_edt(self.valid)
        return np.asarray(np.minimum(gaussian_filter(steps, 2.0), 2 * steps), dtype=np.float32)

    def holds(self, pixels: Array) -> Mask:
        """Return (N,), true where the undistorted picture shows what (N, 2) distorted px see far
        away. It is a pinhole's picture, which ends before 90 degrees from the axis.
        """
        far = self.undistort_pixels(pixels, np.inf)
        in_picture = ((far >= -0.5) & (far <= [self.width - 0.5, self.height - 0.5])).all(-1)
        return np.asarray(in_picture & self.sees(pixels[:, 0], pixels[:, 1], np.inf))

    def hidden_fraction(self, depth: float) -> float:
        """Return the fraction of the picture, 0 to 1, whose rays leave the cover no nearer than a
        depth in m: what is there would stand inside the cover.
        """
        exit_depth = self._exit_depths()
        return float((exit_depth >= depth).mean()) if exit_depth.size else 0.0

    def check_reach(self, depth: float) -> None:
        """Raise InputError unless the camera can see something at this depth in m."""
        check_depth(depth)
        if self.hidden_fraction(depth) == 1.0:
            farthest = math.ceil(1e3 * self._exit_depths().max()) / 1e3
            raise InputError(
                f"depth {depth:g} m is too near: write {farthest:g} m or more, beyond the cover,"
                " such as 0.5."
            )

    def _exit_depths(self) -> Array:
        """Return (n,) m, `nearest` at the valid nodes on the image."""
        x_on_image = (self.nodes_x >= 0) & (self.nodes_x <= self.width - 1)
        y_on_image = (self.nodes_y >= 0) & (self.nodes_y <= self.height - 1)
        return self.nearest[self.valid & y_on_image[:, None] & x_on_image]

    def map_at(self, depth: float, window: Window | None = None) -> DepthMap:
        """Return the map of one depth in m, which may be infinite.

        The default window is the picture of the bare pinhole camera.

        Raises:
            InputError: the depth is inside the cover.
        """
        self.check_reach(depth)
        window = window or self.window
        inverse = invert(self.forward(depth), window)
        made = depth_map(inverse, depth, window, self.sees)
        if not inverse.cells.all():
            self._solve_pixels(made, inverse, window)
        return made

    def _solve_pixels(self, made: DepthMap, inverse: InverseMap, window: Window) -> None:
        """Solve each pixel of the cells around the image in which the spline is not the inverse."""
        ends = np.array([[self.nodes_x[0], self.nodes_y[0]], [self.nodes_x[-1], self.nodes_y[-1]]])
        off_grid = ((inverse.nodes < ends[0]) | (inverse.nodes > ends[1])).any(-1)
        cells = ~(inverse.cells | all_corners_true(off_grid))
        column = cell_index(np.arange(window.width), inverse.columns)
        row = cell_index(np.arange(window.height), inverse.rows)
        ys, xs = np.nonzero(cells[row][:, column])
        pixels = np.stack([xs, ys], -1) * window.zoom + window.corner
        distorted, visible = self.distort_pixels(pixels.astype(np.float64), made.depth)
        made.valid[ys, xs] = visible
        made.x[ys, xs] = np.where(visible, distorted[:, 0], -1)
        made.y[ys, xs] = np.where(visible, distorted[:, 1], -1)

    @cached_property
    def _spline(self) -> Spline:
        """The spline of A and B, four components."""
        return Spline.through(
            self.nodes_x, self.nodes_y, np.concatenate([self.at_infinity, self.parallax], -1)
        )

    def _undistort_with_jacobian(self, pixels: Array, depth: float | Array) -> tuple[Array, Array]:
        """Return the (N, 2) undistorted px of (N, 2) distorted px at a depth in m, one for all or
        (N,), and their (N, 2, 2) Jacobians.
        """
        value, derivatives = self._spline.at(pixels)
        depths = np.broadcast_to(np.asarray(depth, dtype=np.float64), len(pixels))
        inverse_depth = 1 / depths  # 1/m
        return (
            value[:, :2] + inverse_depth[:, None] * value[:, 2:],
            derivatives[:, :2] + inverse_depth[:, None, None] * derivatives[:, 2:],
        )


def check_depth(depth: float) -> None:
    """Raise InputError unless the camera can see something at this depth in m."""
    if not depth > 0:
        raise InputError(
            f"depth {depth:g} is not a distance in front of the camera: write metres above 0, such"
            " as 1.0."
        )
    if depth < MIN_DEPTH:
        raise InputError(
            f"depth {depth:g} m is too near: write {MIN_DEPTH:g} m or more, beyond the cover, such"
            " as 1.0."
        )


def ray_field(
    path: Path, values: Values, width: int, height: int, tolerance: float = TOLERANCE
) -> RayField:
    """Trace the field on a grid so fine that the splines agree with traced rays between its nodes,
    to `tolerance` px.
    """
    for spacing in grid_spacings(FINEST):
        columns = grid_nodes(width, spacing, MARGIN * width)
        rows = grid_nodes(height, spacing, MARGIN * height)
        traced = _trace_grid(path, values, columns, rows)
        valid = traced.forward
        if spacing == SPACING and not valid.any():
            raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
        if spacing > SPACING and not valid.all():
            continue
        displacement = extrapolate(traced.at_infinity - traced.pixels, valid)
        field = RayField(
            width=width,
            height=height,
            nodes_x=columns,
            nodes_y=rows,
            at_infinity=traced.pixels + displacement,
            parallax=extrapolate(traced.parallax, valid),
            valid=valid,
            nearest=extrapolate(traced.exit_z, valid),
        )
        between = _trace_grid(path, values, midpoints(columns), midpoints(rows))
        undistorted = field.undistort_pixels(between.pixels.reshape(-1, 2), CHECK_DEPTH)
        error = np.linalg.norm(
            undistorted.reshape(between.pixels.shape)
            - between.at_infinity
            - between.parallax / CHECK_DEPTH,
            axis=-1,
        )
        complete = all_corners_true(valid) & between.forward
        accurate = complete & (error < MAX_ERROR)
        on_image = (
            np.abs(between.pixels - [(width - 1) / 2, (height - 1) / 2]) <= [width / 2, height / 2]
        ).all(-1)
        if error[interior_cells(complete) & on_image].max(initial=0) < tolerance and (
            spacing <= SPACING or accurate.all()
        ):
            break
        if 4 * len(columns) * len(rows) > MAX_NODES:
            break
    bad = np.pad(~accurate, 1)
    touched = bad[1:, 1:] | bad[1:, :-1] | bad[:-1, 1:] | bad[:-1, :-1]
    return replace(field, valid=valid & ~touched)


@dataclass(frozen=True, slots=True)
class _TracedGrid:
    """The rays of a grid of pixels."""

    pixels: Array
    """(h, w, 2) px"""
    at_infinity: Array
    """(h, w, 2) px, A"""
    parallax: Array
    """(h, w, 2) px m, B"""
    exit_z: Array
    """(h, w) m: the z coordinate where the ray leaves the cover."""
    forward: Mask
    """(h, w), true where the ray leaves the cover and goes forward."""


def _trace_grid(path: Path, values: Values, columns: Array, rows: Array) -> _TracedGrid:
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    fx = values[CAMERA.fx]
    fy = values[CAMERA.fy]
    cx = values[CAMERA.cx]
    cy = values[CAMERA.cy]
    batches = []
    for first in range(0, len(columns) * len(rows), BATCH_SIZE):
        batch = torch.from_numpy(pixels.reshape(-1, 2)[first : first + BATCH_SIZE])
        rays = path.trace(batch, values, MIDDLE)
        forward = rays.in_pinhole
        direction_z = torch.where(forward, rays.direction.z, torch.ones_like(rays.direction.z))
        tan_x, tan_y = rays.direction.x / direction_z, rays.direction.y / direction_z
        at_infinity = torch.stack([fx * tan_x + cx, fy * tan_y + cy], -1)
        parallax = torch.stack(
            [
                fx * (rays.origin.x - tan_x * rays.origin.z),
                fy * (rays.origin.y - tan_y * rays.origin.z),
            ],
            -1,
        )
        batches.append((at_infinity, parallax, rays.origin.z, forward))
    shape = pixels.shape[:2]
    return _TracedGrid(
        pixels=pixels,
        at_infinity=torch.cat([batch[0] for batch in batches]).numpy().reshape(pixels.shape),
        parallax=torch.cat([batch[1] for batch in batches]).numpy().reshape(pixels.shape),
        exit_z=torch.cat([batch[2] for batch in batches]).numpy().reshape(shape),
        forward=torch.cat([batch[3] for batch in batches]).numpy().reshape(shape),
    )
