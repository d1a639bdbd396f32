"""The seen corners of all views, row after row, as tensors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.board import Board
from calib.views import View


@dataclass(frozen=True, slots=True)
class Observations:
    """M corners in V views; the rows of one view stand together."""

    names: tuple[str, ...]
    """V view names."""
    pixels: Tensor
    """(M, 2) px, where each corner was seen."""
    corners: Tensor
    """(M, 2) m, where it is on the board."""
    weight: Tensor
    """(M,) at most 1: the factor on the residual."""
    starts: Tensor
    """(V + 1,) int64: the rows of view v are starts[v] to starts[v + 1]."""

    @staticmethod
    def of(views: Sequence[View], board: Board) -> "Observations":
        points = board.points()
        seen = [view.seen for view in views]
        counts = [0, *(int(mask.sum()) for mask in seen)]
        return Observations(
            names=tuple(view.name for view in views),
            pixels=_joined([view.corners[mask] for view, mask in zip(views, seen, strict=True)], (0, 2)),
            corners=_joined([points[mask] for mask in seen], (0, 2)),
            weight=_joined([view.weight[mask] for view, mask in zip(views, seen, strict=True)], (0,)),
            starts=torch.tensor(np.cumsum(counts)),
        )

    def kept(self, rows: Tensor) -> "Observations":
        """Only the rows where (M,) bool is true; no view disappears."""
        ends = torch.cat([self.starts.new_zeros(1), rows.cumsum(0)])[self.starts]
        return Observations(self.names, self.pixels[rows], self.corners[rows], self.weight[rows], ends)

    def to(self, device: str) -> "Observations":
        """The same on another device."""
        tensors = (part.to(device) for part in (self.pixels, self.corners, self.weight, self.starts))
        return Observations(self.names, *tensors)

    def run(self, views: range) -> "Observations":
        """Some consecutive views."""
        rows = slice(int(self.starts[views.start]), int(self.starts[views.stop]))
        starts = self.starts[views.start : views.stop + 1] - self.starts[views.start]
        return Observations(self.names[views.start : views.stop], self.pixels[rows], self.corners[rows], self.weight[rows], starts)

    @property
    def view(self) -> Tensor:
        """(M,) int64: each row's view."""
        return torch.repeat_interleave(torch.arange(len(self.names), device=self.starts.device), self.starts.diff())

    def per_view(self, rows: Tensor) -> list[Tensor]:
        """(M, ...) split into one (n, ...) for each view."""
        return list(torch.split(rows, self.starts.diff().tolist()))


def _joined(parts: Sequence[NDArray[np.float64]], empty: tuple[int, ...]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts) if parts else np.zeros(empty))
