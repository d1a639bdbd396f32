"""The outer surface of a cover in detail: what dense points of a screen show of it beyond the
relief.

A ray of a pixel leaves the glass at one place. Where the points of all views are off alike at a
pixel, the glass there is steeper than the model says. These slopes are integrated to heights, by
least squares over all neighbours: B. K. P. Horn, M. J. Brooks, The variational approach to shape
from shading (1986), with slopes in place of shading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu
from torch import Tensor

from calib.calibration import Calibration
from calib.inference.effect_context import with_any_relief
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.placement import Placement
from calib.optics.relief import AMPLITUDES, PROBES
from calib.session.point_target import PointView

MAX_VIEWS = 6
"""Views whose points are used: slopes are seen far better than it takes."""
MIN_POINTS = 5_000
"""The fewest points of a view that show a surface in detail."""
MAX_CELLS = 60_000
"""Cells of the picture, of which each has one slope."""
BLOCK = 32.0
"""px: the side of the blocks in which points are counted."""
DENSE = 0.7
"""The quantile of these counts that is not at an edge of a view."""
LEVEL = 1e-9
"""The weight of the height itself beside that of differences, which do not tell its mean."""

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class GlassDetail:
    """Heights of the outer surface over the model's relief, where the rays of pixels leave it."""

    x: Array
    """(w,) px"""
    y: Array
    """(h,) px"""
    height: Array
    """(h, w) m, the mean is zero; NaN where no view has a point."""
    noise: float
    """m: the standard deviation that two halves of the views have about their mean."""


def glass_detail(calibration: Calibration, views: Sequence[PointView]) -> GlassDetail | None:
    """Return the heights that points show; None without a cover, or where points are too few.

    Args:
        views: all points of views of the calibration, as `read_dense_points` gives them. Others are
            left out.
    """
    path, values = calibration.model()
    index = {view.name: place for place, view in enumerate(calibration.views)}
    dense = [v for v in views if v.name in index and len(v.pixels) >= MIN_POINTS]
    if not path.cover or len(dense) < 2:
        return None
    used = evenly(dense, MAX_VIEWS)
    cells = _Cells.of([view.pixels for view in used])
    used = [_thinned(view, cells) for view in used]
    normal = np.zeros((2, cells.count, 2, 2))
    right = np.zeros((2, cells.count, 2))
    for number, view in enumerate(used):
        pose = torch.from_numpy(calibration.poses[index[view.name]])
        landed, slopes = _land(path, values, view.pixels, pose)
        lands = np.isfinite(landed).all(-1)
        landed, slopes = landed[lands], slopes[lands]
        # A point counts by its pixel's variance: on the target, it is as far as slopes reach.
        spread = (slopes**2).sum((1, 2)) * np.trace(view.covariance, axis1=1, axis2=2)[lands]
        residual = view.places[lands] - landed
        place, half = cells.of_pixels(view.pixels[lands]), number % 2
        for i in range(2):
            for k in range(2):
                products = (slopes[:, :, i] * slopes[:, :, k]).sum(1) / spread
                normal[half, :, i, k] += np.bincount(place, products, cells.count)
            moments = (slopes[:, :, i] * residual).sum(1) / spread
            right[half, :, i] += np.bincount(place, moments, cells.count)
    in_halves = np.all(normal[:, :, 0, 0] > 0, axis=0)
    normal[:, ~in_halves] = normal[:, ~in_halves].sum(0)
    right[:, ~in_halves] = right[:, ~in_halves].sum(0)
    visible: NDArray[np.bool_] = np.all(np.linalg.det(normal) > 0, axis=0)
    chart = exit_chart(path, values, cells.middles()[visible])
    visible[visible] = np.isfinite(chart).all(-1)
    chart = chart[np.isfinite(chart).all(-1)]
    slopes = np.asarray(np.linalg.solve(normal[:, visible], right[:, visible, :, None])[..., 0])
    heights = integrate_slopes(cells.grid(visible), chart, slopes)
    height = np.full(cells.count, np.nan)
    model = heights_of_effects(path, values, chart)
    height[visible] = heights.mean(0) + model - model.mean()
    rows, columns = cells.shape
    return GlassDetail(
        x=cells.low[0] + cells.side * np.arange(columns),
        y=cells.low[1] + cells.side * np.arange(rows),
        height=height.reshape(cells.shape),
        noise=float(np.std(heights[0] - heights[1]) / 2),
    )


def evenly(items: Sequence[T], count: int) -> list[T]:
    """Return so many of the items at the most, from the first to the last."""
    places = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(np.int64)
    return [items[place] for place in places]


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Squares of the picture."""

    low: Array
    """(2,) px, the middle of the first square."""
    side: float
    """px"""
    shape: tuple[int, int]
    """Rows and columns."""

    @staticmethod
    def of(views: Sequence[Array]) -> _Cells:
        """Return squares for the (N, 2) px of each view: as large as the places between points in
        most of the picture, or a multiple of that where there would be too many.
        """
        low = np.min([pixels.min(0) for pixels in views], axis=0)
        extent = np.max([pixels.max(0) for pixels in views], axis=0) - low
        counts = [
            np.unique((pixels - low) // BLOCK, axis=0, return_counts=True)[1] for pixels in views
        ]
        side = np.ceil(BLOCK / np.quantile(np.concatenate(counts), DENSE) ** 0.5 - 0.1)
        side *= np.ceil((extent.prod() / side**2 / MAX_CELLS) ** 0.5)
        columns, rows = (np.floor(extent / side + 0.5) + 1).astype(np.int64).tolist()
        return _Cells(low, float(side), (rows, columns))

    @property
    def count(self) -> int:
        return self.shape[0] * self.shape[1]

    def of_pixels(self, pixels: Array) -> NDArray[np.int64]:
        """Return the (N,) squares of (N, 2) px."""
        column, row = np.floor((pixels - self.low) / self.side + 0.5).astype(np.int64).T
        return np.asarray(row * self.shape[1] + column)

    def middles(self) -> Array:
        """Return the (count, 2) px of the middles."""
        row, column = np.divmod(np.arange(self.count), self.shape[1])
        return np.asarray(self.low + self.side * np.stack([column, row], -1))

    def grid(self, visible: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return (rows, columns) the numbers of the visible squares among these; -1 for others."""
        numbers = np.full(self.count, -1, np.int64)
        numbers[visible] = np.arange(np.count_nonzero(visible))
        return numbers.reshape(self.shape)


def _thinned(view: PointView, cells: _Cells) -> PointView:
    """Return the view with at most a point in each square, where it has many more than squares."""
    if len(view.pixels) < 2 * MAX_CELLS:
        return view
    _, first = np.unique(cells.of_pixels(view.pixels), return_index=True)
    return PointView(view.name, view.pixels[first], view.places[first], view.covariance[first])


def integrate_slopes(grid: NDArray[np.int64], chart: Array, slopes: Array) -> Array:
    """Return (K, N) m, the heights at N places of a surface, for K sets of slopes.

    Args:
        grid: the numbers of neighbouring places; -1 where there is none.
        chart: (N, 2) chart coordinates of the places.
        slopes: (K, N, 2) m per unit of the chart.
    """
    rows = np.stack([grid[:, :-1].ravel(), grid[:, 1:].ravel()], -1)
    columns = np.stack([grid[:-1].ravel(), grid[1:].ravel()], -1)
    pairs = np.concatenate([rows, columns])
    first, second = pairs[(pairs >= 0).all(-1)].T
    rises = ((slopes[:, first] + slopes[:, second]) / 2 * (chart[second] - chart[first])).sum(-1)
    count, pair = len(chart), np.arange(len(first))
    entries = np.repeat([-1.0, 1.0], len(first))
    places = np.concatenate([pair, pair]), np.concatenate([first, second])
    differences = coo_array((entries, places), shape=(len(first), count)).tocsc()
    laplacian = splu((differences.T @ differences + LEVEL * eye_array(count)).tocsc())
    heights = laplacian.solve((rises @ differences).T).T
    return np.asarray(heights - heights.mean(1, keepdims=True))


def _land(path: Path, values: Values, pixels: Array, pose: Tensor) -> tuple[Array, Array]:
    """Return (N, 2) m, where the rays of (N, 2) px land on a target with this (B,) pose, and
    (N, 2, 2) the derivatives by the outer surface's slopes where they leave it; NaN where no ray
    does.
    """
    path, values = with_any_relief(path, values)
    poses = pose.expand(len(pixels), -1)
    trace = path.trace_with_derivatives(
        torch.from_numpy(pixels),
        path.values_of_views(values, poses),
        MIDDLE,
        frozenset({AMPLITUDES}),
    )
    placement = Placement.of(poses).at_exposure(MIDDLE)
    landed, failure, landing = path.target.land(trace.rays, placement, values)
    identity = torch.eye(2, dtype=torch.float64)[:, None].expand(2, len(pixels), 2)
    by = trace.pull(landing.pull(identity)[0])
    slopes = torch.stack([by[name] for name in PROBES[1:]], -1).transpose(0, 1)  # (N, 2, 2)
    landed = torch.where((failure == 0)[:, None], landed, torch.nan)
    return landed.detach().numpy(), slopes.detach().numpy()


def exit_chart(path: Path, values: Values, pixels: Array) -> Array:
    """Return the (N, 2) chart coordinates, SI, where the rays of (N, 2) px leave the glass; NaN
    where no ray does.
    """
    outer = path.cover[-1]
    rays = path.trace(torch.from_numpy(pixels), values, MIDDLE)
    _, adjusted = path.adjust_pixels(torch.from_numpy(pixels), values, MIDDLE)
    chart = torch.stack(outer.surface.chart(outer.frame.at(adjusted).enter(rays.origin)), -1)
    return torch.where((rays.failure != 0).unsqueeze(-1), torch.nan, chart).numpy()


def heights_of_effects(path: Path, values: Values, chart: Array) -> Array:
    """Return the (...) m heights of the reliefs that effects have added to the outer surface, at
    (..., 2) chart coordinates.
    """
    first, second = torch.from_numpy(chart).unbind(-1)
    heights = [relief.height((first, second), values)[0] for relief in path.cover[-1].extra_reliefs]
    return np.asarray(sum(heights, torch.zeros_like(first)).numpy())
