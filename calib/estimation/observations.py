"""The seen corners of all views, row after row, as tensors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.optics.params import LINE, TIME, Values
from calib.session.board import Board


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
    moment: Tensor | None = None
    """(M, 2): when each corner was seen, in the session and during its picture's readout, both from
    -0.5 to 0.5.
    """

    @staticmethod
    def of(views: Sequence[View], board: Board) -> "Observations":
        points = board.points()
        seen = [view.seen for view in views]
        counts = [0, *(int(mask.sum()) for mask in seen)]
        return Observations(
            names=tuple(view.name for view in views),
            pixels=_joined(
                [view.corners[mask] for view, mask in zip(views, seen, strict=True)], (0, 2)
            ),
            corners=_joined([points[mask] for mask in seen], (0, 2)),
            weight=_joined(
                [view.weight[mask] for view, mask in zip(views, seen, strict=True)], (0,)
            ),
            starts=torch.tensor(np.cumsum(counts)),
        )

    def kept(self, rows: Tensor) -> "Observations":
        """Only the rows where (M,) bool is true; no view disappears."""
        ends = torch.cat([self.starts.new_zeros(1), rows.cumsum(0)])[self.starts]
        moment = None if self.moment is None else self.moment[rows]
        return Observations(
            self.names, self.pixels[rows], self.corners[rows], self.weight[rows], ends, moment
        )

    def without(self, views: Tensor) -> "Observations":
        """Only the views where (V,) bool is false."""
        rows = ~views[self.view]
        names = tuple(name for name, out in zip(self.names, views.tolist(), strict=True) if not out)
        starts = torch.cat([self.starts.new_zeros(1), self.starts.diff()[~views].cumsum(0)])
        moment = None if self.moment is None else self.moment[rows]
        return Observations(
            names, self.pixels[rows], self.corners[rows], self.weight[rows], starts, moment
        )

    def timed(
        self, times: Sequence[float] | NDArray[np.float64] | None, height: int
    ) -> "Observations":
        """The same, with each view's time (V,), in any unit, and the lines of a picture of `height`
        px read from top to bottom.

        Without times, all views are from the middle of the session.
        """
        each = np.zeros(len(self.names)) if times is None else np.asarray(times, dtype=np.float64)
        time = torch.from_numpy(each).to(self.pixels)
        span = float(time.max() - time.min()) if len(time) else 0.0
        own = ((time - time.min()) / span - 0.5 if span else torch.zeros_like(time))[self.view]
        return replace(
            self, moment=torch.stack([own, (self.pixels[:, 1] + 0.5) / height - 0.5], -1)
        )

    def with_times(self, values: Values) -> Values:
        """The parameters of a path, and when each corner was seen."""
        return (
            values
            if self.moment is None
            else {**values, TIME: self.moment[:, 0], LINE: self.moment[:, 1]}
        )

    def to(self, device: str) -> "Observations":
        """The same on another device."""
        pixels, corners, weight, starts = (
            part.to(device) for part in (self.pixels, self.corners, self.weight, self.starts)
        )
        return Observations(
            self.names,
            pixels,
            corners,
            weight,
            starts,
            None if self.moment is None else self.moment.to(device),
        )

    def run(self, views: range) -> "Observations":
        """Some consecutive views."""
        rows = slice(int(self.starts[views.start]), int(self.starts[views.stop]))
        starts = self.starts[views.start : views.stop + 1] - self.starts[views.start]
        moment = None if self.moment is None else self.moment[rows]
        return Observations(
            self.names[views.start : views.stop],
            self.pixels[rows],
            self.corners[rows],
            self.weight[rows],
            starts,
            moment,
        )

    @property
    def view(self) -> Tensor:
        """(M,) int64: each row's view."""
        return torch.repeat_interleave(
            torch.arange(len(self.names), device=self.starts.device), self.starts.diff()
        )

    def per_view(self, rows: Tensor) -> list[Tensor]:
        """(M, ...) split into one (n, ...) for each view."""
        return list(torch.split(rows, self.starts.diff().tolist()))


def _joined(parts: Sequence[NDArray[np.float64]], empty: tuple[int, ...]) -> Tensor:
    return torch.from_numpy(np.concatenate(parts) if parts else np.zeros(empty))
