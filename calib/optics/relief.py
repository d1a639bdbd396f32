"""The relief of a glass surface: its height above the perfect shape, as a Gaussian radial basis
function (RBF) network.

Its centres form a regular grid over the surface's chart, and its amplitudes are what a fit
estimates (the paper's section 2, equation 1). A height and its gradient are sums of products of
one-dimensional Gaussians, so both cost rows + columns exponentials a point.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.linear_part import sloped
from calib.optics.params import Param, Values

AMPLITUDES = "relief.amplitudes"
"""Of the outer surface's relief, which a fit estimates."""

PROBES = ("probe.height", "probe.first", "probe.second")
"""Optional values, (...) each: what is added to the height and to the two slopes at each ray's own
hit. Derivatives by these three give those by every amplitude, through `spread`.
"""


@dataclass(frozen=True, slots=True)
class Relief:
    """A height Phi(s) = sum a_ij exp(-|s - s_ij|^2 / (2 beta)) over a surface's chart.

    Chart coordinates are normalised by the spacing of the centres, in each direction by its own.
    With n x n centres, the paper's patch normalised to [0, 1] and its beta, ours is beta (n - 1)^2.
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
        return (self.high[0] - self.low[0]) / (self.grid[0] - 1), (self.high[1] - self.low[1]) / (
            self.grid[1] - 1
        )

    def height(self, chart: tuple[Tensor, Tensor], values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Two (...) chart coordinates to (...) m, and to its two (...) slopes, m per chart unit."""
        amplitudes = values[f"{self.name}.amplitudes"]  # (rows, columns), or one for each point
        if (
            torch.is_grad_enabled()
            and any(coordinate.requires_grad for coordinate in chart)
            and not amplitudes.requires_grad
        ):
            height, by_first, by_second = self._sloped(amplitudes, chart)
        else:
            first, second = (self.bells(coordinate, axis) for axis, coordinate in enumerate(chart))
            mixed, rise_mixed = (_mixed(amplitudes, bells) for bells in second)
            height, by_first, by_second = (
                (mixed * first[0]).sum(0),
                (mixed * first[1]).sum(0),
                (rise_mixed * first[0]).sum(0),
            )
        if self.name != "relief" or PROBES[0] not in values:
            return height, by_first, by_second
        level, tilt_first, tilt_second = (values[name] for name in PROBES)
        lean = tilt_first * (chart[0] - chart[0].detach()) + tilt_second * (
            chart[1] - chart[1].detach()
        )  # zero, but for its slopes
        return height + level + lean, by_first + tilt_first, by_second + tilt_second

    def _sloped(
        self, amplitudes: Tensor, chart: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The same height and slopes with their first derivatives by the chart, which are known:
        nothing is kept of the sums.
        """
        with torch.no_grad():
            bells, rise, bend = zip(
                *(self._bent_bells(coordinate, axis) for axis, coordinate in enumerate(chart)),
                strict=True,
            )
            mixed, rise_mixed, bend_mixed = (
                _mixed(amplitudes, each[1]) for each in (bells, rise, bend)
            )
            height, by_first, by_second = (
                (mixed * bells[0]).sum(0),
                (mixed * rise[0]).sum(0),
                (rise_mixed * bells[0]).sum(0),
            )
            twice, both, other = (
                (mixed * bend[0]).sum(0),
                (rise_mixed * rise[0]).sum(0),
                (bend_mixed * bells[0]).sum(0),
            )
        return (
            sloped(height, *chart, by_first, by_second),
            sloped(by_first, *chart, twice, both),
            sloped(by_second, *chart, both, other),
        )

    def spread(self, by_probe: Tensor, chart: tuple[Tensor, Tensor], out: Tensor) -> None:
        """Derivatives by every amplitude, row by row, from those by the height and the two slopes
        at each point.

        Args:
            by_probe: (M, k, 3), in the order of PROBES.
            chart: (M,) coordinates each.
            out: (M, k, rows * columns), to be written to.
        """
        first, rise_first = (
            bells.mT.contiguous()[:, None, :, None] for bells in self.bells(chart[0], 0)
        )  # (M, 1, rows, 1)
        second, rise_second = (
            bells.mT.contiguous()[:, None, :] for bells in self.bells(chart[1], 1)
        )  # (M, 1, columns)
        level, by_first, by_second = by_probe.unsqueeze(-2).unbind(-1)  # (M, k, 1)
        along, across = (
            each.unsqueeze(-2)
            for each in (level * second + by_second * rise_second, by_first * second)
        )  # (M, k, 1, columns)
        torch.mul(first, along, out=out.view(*out.shape[:-1], *self.grid)).addcmul_(
            rise_first, across
        )

    def bells(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """The (n, ...) one-dimensional Gaussians of one axis, and their derivatives by the chart
        coordinate.
        """
        away, bells = self._away(coordinate, axis)
        return bells, away * bells * (-1 / (self.beta * self.spacing[axis]))

    def _bent_bells(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor, Tensor]:
        """The same with the second derivatives."""
        away, bells = self._away(coordinate, axis)
        fall = -1 / (self.beta * self.spacing[axis])
        rise = away * bells * fall
        return bells, rise, (away * rise + bells / self.spacing[axis]) * fall

    def _away(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """(n, ...) distances from the centres of one axis, in spacings, and the Gaussians there."""
        centres = torch.arange(self.grid[axis], dtype=coordinate.dtype, device=coordinate.device)
        away = (coordinate - self.low[axis]) / self.spacing[axis] - centres.reshape(
            -1, *(1,) * coordinate.ndim
        )
        return away, torch.exp(away * away * (-0.5 / self.beta))


def _mixed(amplitudes: Tensor, bells: Tensor) -> Tensor:
    """(rows, ...) sums over the second chart coordinate's (columns, ...) bells."""
    if amplitudes.ndim == 2:
        return torch.tensordot(amplitudes, bells, dims=([1], [0]))  # type: ignore[no-any-return]
    return torch.einsum("...rc,c...->r...", amplitudes, bells)
