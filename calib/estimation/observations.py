"""The detected corners of all views as tensors, a row for each corner."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.optics.exposure import Exposure
from calib.session.board import Board

BATCH_SIZE = 8192
"""The number of corners whose rays are in memory together: 0.1 GB with their derivatives by 16x16
centres.
"""


@dataclass(frozen=True, slots=True)
class Observations:
    """M corners in V views; the rows of one view stand together."""

    names: tuple[str, ...]
    """V view names."""
    pixels: Tensor
    """(M, 2) px, the detected position of each corner."""
    corners: Tensor
    """(M, 2) m, its position on a flat board, or (M, 3) m on a target that is not flat."""
    weight: Tensor
    """(M,) at most 1: the factor on the residual."""
    starts: Tensor
    """(V + 1,) int64: the rows of view v are starts[v] to starts[v + 1]."""
    exposure: Exposure | None = None
    """(M,) the exposure of each corner; None for corners in the middle of session and readout."""
    whitening: Tensor | None = None
    """(M, 2, 2) the factor on the residual in the image that makes its axes equally uncertain, for
    points of a target whose covariances are known. The mean of both variances is that of the
    weight. None: they are equal.
    """
    merged: int = 0
    """The number of corners for which averages of several stand, less that of the averages
    (`corner_cells`).
    """
    merged_squares: float = 0.0
    """px^2, the squares of the errors of these corners about their averages, by their weights."""

    @staticmethod
    def of(views: Sequence[View], board: Board) -> "Observations":
        points = board.points()
        masks = [view.seen for view in views]
        pixels = [view.corners[mask] for view, mask in zip(views, masks, strict=True)]
        weights = [view.weight[mask] for view, mask in zip(views, masks, strict=True)]
        whitenings = [
            _whitening(view.covariance[mask])
            for view, mask in zip(views, masks, strict=True)
            if view.covariance is not None and not board.has_grid
        ]
        counts = [0, *(int(mask.sum()) for mask in masks)]
        return Observations(
            names=tuple(view.name for view in views),
            pixels=_concatenate(pixels, (0, 2)),
            corners=_concatenate([points[mask] for mask in masks], (0, points.shape[1])),
            weight=_concatenate(weights, (0,)),
            starts=torch.tensor(np.cumsum(counts)),
            whitening=_concatenate(whitenings, (0, 2, 2)) if whitenings else None,
        )

    def select_rows(self, rows: Tensor) -> "Observations":
        """Return only the rows where (M,) bool is true; no view disappears."""
        starts = torch.cat([self.starts.new_zeros(1), rows.cumsum(0)])[self.starts]
        return Observations(
            names=self.names,
            pixels=self.pixels[rows],
            corners=self.corners[rows],
            weight=self.weight[rows],
            starts=starts,
            exposure=self.exposure and self.exposure[rows],
            whitening=None if self.whitening is None else self.whitening[rows],
            merged=self.merged,
            merged_squares=self.merged_squares,
        )

    def without_views(self, views: Tensor) -> "Observations":
        """Return only the views where (V,) bool is false."""
        rows = ~views[self.view]
        names = tuple(name for name, out in zip(self.names, views.tolist(), strict=True) if not out)
        starts = torch.cat([self.starts.new_zeros(1), self.starts.diff()[~views].cumsum(0)])
        return Observations(
            names=names,
            pixels=self.pixels[rows],
            corners=self.corners[rows],
            weight=self.weight[rows],
            starts=starts,
            exposure=self.exposure and self.exposure[rows],
            whitening=None if self.whitening is None else self.whitening[rows],
        )

    def add_times(
        self, times: Sequence[float] | NDArray[np.float64] | None, height: int
    ) -> "Observations":
        """Return the same with each view's time (V,), in any unit, for a picture of `height` px
        that is read out from top to bottom.

        Without times, these are not the views of a calibration, and all are from the middle of its
        session.
        """
        seconds = np.zeros(len(self.names)) if times is None else np.asarray(times, np.float64)
        time = torch.from_numpy(seconds).to(self.pixels)
        span = float(time.max() - time.min()) if len(time) else 0.0
        relative = (time - time.min()) / span - 0.5 if span else torch.zeros_like(time)
        line = (self.pixels[:, 1] + 0.5) / height - 0.5
        view = None if times is None else self.view
        return replace(self, exposure=Exposure(relative[self.view], line, view))

    def to(self, device: str) -> "Observations":
        """Return the same on another device."""
        return Observations(
            names=self.names,
            pixels=self.pixels.to(device),
            corners=self.corners.to(device),
            weight=self.weight.to(device),
            starts=self.starts.to(device),
            exposure=self.exposure and self.exposure.to(device),
            whitening=None if self.whitening is None else self.whitening.to(device),
        )

    def view_range(self, views: range) -> "Observations":
        """Return some consecutive views."""
        rows = slice(int(self.starts[views.start]), int(self.starts[views.stop]))
        starts = self.starts[views.start : views.stop + 1] - self.starts[views.start]
        return Observations(
            names=self.names[views.start : views.stop],
            pixels=self.pixels[rows],
            corners=self.corners[rows],
            weight=self.weight[rows],
            starts=starts,
            exposure=self.exposure and self.exposure[rows],
            whitening=None if self.whitening is None else self.whitening[rows],
        )

    def batches(self, size: int = BATCH_SIZE) -> Iterator["Observations"]:
        """Yield consecutive rows, about `size` at a time, for what is computed row by row. Each
        batch has all views; most have no row in it.
        """
        count = len(self.pixels)
        if count <= size:
            yield self
            return
        for first in range(0, count, size):
            rows = slice(first, first + size)
            yield Observations(
                names=self.names,
                pixels=self.pixels[rows],
                corners=self.corners[rows],
                weight=self.weight[rows],
                starts=(self.starts - first).clamp(0, min(size, count - first)),
                exposure=self.exposure and self.exposure[rows],
                whitening=None if self.whitening is None else self.whitening[rows],
            )

    @property
    def residual_count(self) -> int:
        """The number of residuals: two for each corner, also for one that an average stands for."""
        return 2 * (len(self.pixels) + self.merged)

    @property
    def view(self) -> Tensor:
        """The (M,) int64 index of each row's view."""
        return torch.repeat_interleave(
            torch.arange(len(self.names), device=self.starts.device), self.starts.diff()
        )

    def per_view(self, rows: Tensor) -> list[Tensor]:
        """Split (M, ...) rows into one (n, ...) tensor for each view."""
        return list(torch.split(rows, self.starts.diff().tolist()))


def _concatenate(arrays: Sequence[NDArray[np.float64]], empty: tuple[int, ...]) -> Tensor:
    """Return the concatenation of the arrays; zeros of the shape `empty` if there is none."""
    return torch.from_numpy(np.concatenate(arrays) if arrays else np.zeros(empty))


def _whitening(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n, 2, 2) inverse roots of covariances (n, 2, 2), in units of their own mean
    standard deviations.
    """
    variances, axes = np.linalg.eigh(covariance)
    scale = np.sqrt(variances.mean(-1, keepdims=True) / variances)
    return np.asarray((axes * scale[:, None, :]) @ axes.swapaxes(1, 2))
