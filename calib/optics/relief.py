"""The unevenness of a surface: a Gaussian RBF network on a regular grid of centres (the paper's section 2, equation 1)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.params import Param, Values


@dataclass(frozen=True, slots=True)
class Relief:
    """A height Phi(s) = sum a_ij exp(-|s - s_ij|^2 / (2 beta)) over a surface's chart.

    Chart coordinates are normalised by the spacing of the centres, in each direction by its own. With n x n centres, the paper's
    patch normalised to [0, 1] and its beta, ours is beta (n - 1)^2.
    """

    low: tuple[float, float]
    """Chart coordinates of the first centre."""
    high: tuple[float, float]
    """Chart coordinates of the last centre."""
    grid: tuple[int, int]
    """Centres along the first and along the second chart coordinate, two or more each."""
    beta: float = 1.0
    """Squared width of a Gaussian, in units of the squared spacing."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (Param("relief.amplitudes", "m", 1e-5),)

    @property
    def spacing(self) -> tuple[float, float]:
        """The distance between neighbouring centres, in chart units."""
        return tuple((b - a) / (n - 1) for a, b, n in zip(self.low, self.high, self.grid, strict=True))  # type: ignore[return-value]

    def height(self, chart: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(..., 2) chart coordinates to (...) m, and to its slopes (..., 2), m per chart unit."""
        amplitudes = values["relief.amplitudes"]  # (rows, columns)
        first, rise_first = self._bells(chart[..., 0], 0)  # (..., rows)
        second, rise_second = self._bells(chart[..., 1], 1)  # (..., columns)
        mixed = first @ amplitudes  # (..., columns)
        slopes = torch.stack([((rise_first @ amplitudes) * second).sum(-1), (mixed * rise_second).sum(-1)], -1)
        return (mixed * second).sum(-1), slopes

    def _bells(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """The (..., n) one-dimensional Gaussians of one axis and their derivatives by the chart coordinate."""
        step = self.spacing[axis]
        centres = torch.arange(self.grid[axis], dtype=coordinate.dtype, device=coordinate.device)
        away = ((coordinate - self.low[axis]) / step).unsqueeze(-1) - centres
        bells = torch.exp(-(away**2) / (2 * self.beta))
        return bells, -away / (self.beta * step) * bells
