"""The relief of a glass surface: its height above the perfect shape, as a Gaussian radial basis function (RBF) network.

Its centres form a regular grid over the surface's chart, and its amplitudes are what a fit estimates (the paper's section 2, equation 1).
A height and its gradient are sums of products of one-dimensional Gaussians, so both cost rows + columns exponentials a point.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.params import Param, Values

AMPLITUDES = "relief.amplitudes"
"""Of the outer surface's relief, which a fit estimates."""

PROBES = ("probe.height", "probe.first", "probe.second")
"""Optional values, (...) each: what is added to the height and to the two slopes at each ray's own hit. Derivatives by these three
give those by every amplitude, through `spread`."""


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
    name: str = "relief"
    """The values hold its amplitudes as NAME.amplitudes. Only the one called relief has probes."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (Param(f"{self.name}.amplitudes", "m", 1e-5, self.grid),)

    @property
    def spacing(self) -> tuple[float, float]:
        """The distance between neighbouring centres, in chart units."""
        return (self.high[0] - self.low[0]) / (self.grid[0] - 1), (self.high[1] - self.low[1]) / (self.grid[1] - 1)

    def height(self, chart: tuple[Tensor, Tensor], values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Two (...) chart coordinates to (...) m, and to its two (...) slopes, m per chart unit."""
        amplitudes = values[f"{self.name}.amplitudes"]  # (rows, columns), or one for each point
        first, rise_first = self.bells(chart[0], 0)  # (rows, ...)
        second, rise_second = self.bells(chart[1], 1)  # (columns, ...)
        if amplitudes.ndim == 2:
            mixed, rise_mixed = (torch.tensordot(amplitudes, bells, dims=([1], [0])) for bells in (second, rise_second))  # (rows, ...)
        else:
            mixed, rise_mixed = (torch.einsum("...rc,c...->r...", amplitudes, bells) for bells in (second, rise_second))
        height, by_first, by_second = (mixed * first).sum(0), (mixed * rise_first).sum(0), (rise_mixed * first).sum(0)
        if self.name != "relief" or PROBES[0] not in values:
            return height, by_first, by_second
        level, tilt_first, tilt_second = (values[name] for name in PROBES)
        lean = tilt_first * (chart[0] - chart[0].detach()) + tilt_second * (chart[1] - chart[1].detach())  # zero, but for its slopes
        return height + level + lean, by_first + tilt_first, by_second + tilt_second

    def spread(self, by_probe: Tensor, chart: tuple[Tensor, Tensor]) -> Tensor:
        """Derivatives by every amplitude, row by row, from those by the height and the two slopes at each point.

        Args:
            by_probe: (M, k, 3), in the order of PROBES.
            chart: (M,) coordinates each.

        Returns:
            (M, k, rows * columns)
        """
        first, rise_first = (bells.mT[:, None, :, None] for bells in self.bells(chart[0], 0))  # (M, 1, rows, 1)
        second, rise_second = (bells.mT[:, None, :] for bells in self.bells(chart[1], 1))  # (M, 1, columns)
        level, by_first, by_second = by_probe.unsqueeze(-2).unbind(-1)  # (M, k, 1)
        along = (level * second + by_second * rise_second).unsqueeze(-2)  # (M, k, 1, columns)
        return torch.addcmul(first * along, rise_first, (by_first * second).unsqueeze(-2)).flatten(2)

    def bells(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """The (n, ...) one-dimensional Gaussians of one axis, and their derivatives by the chart coordinate."""
        step = self.spacing[axis]
        centres = torch.arange(self.grid[axis], dtype=coordinate.dtype, device=coordinate.device)
        away = (coordinate - self.low[axis]) / step - centres.reshape(-1, *(1,) * coordinate.ndim)
        bells = torch.exp(away * away * (-0.5 / self.beta))
        return bells, away * bells * (-1 / (self.beta * step))
