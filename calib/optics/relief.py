"""The relief of a glass surface: its height above the perfect shape, as a Gaussian radial basis
function (RBF) network.

Its centres form a regular grid over the surface's chart, and a fit estimates its amplitudes (the
paper's equation 1). A height and its gradient are sums of products of one-dimensional Gaussians, so
both cost rows + columns exponentials a point.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.linear_term import with_slopes
from calib.optics.params import Param, Values

AMPLITUDES = "relief.amplitudes"
"""The amplitudes of the outer surface's relief, which a fit estimates."""

PROBES = ("probe.height", "probe.first", "probe.second")
"""The names of the height and of the two slopes of the outer relief at each ray's hit. From the
derivatives by these three, `spread` computes those by every amplitude.
"""

INSET_CENTRES = 12
"""The number of centres beyond which the inset keeps its number of spacings."""
INSET = 4 / (INSET_CENTRES - 1)
"""The inset of a fitted relief: two spacings of twelve centres, and of more. The heights at as many
points as there are centres determine the amplitudes. If these points reached to the outermost
centres, a parabola of 10 um would come out wrong by 0.3 um between them, thirty times what corners
show; with two spacings, by a nanometre.
"""


def inset_of(count: int, inset: float) -> float:
    """Return the inset along an axis of this many centres.

    A Gaussian that is many spacings away from the nearest point of the prior hardly reaches it, so
    its amplitude could be anything: 24 centres with the inset of twelve had amplitudes of 0.7 m.
    """
    return min(inset, inset * (INSET_CENTRES - 1) / (count - 1))


MIN_BUMP_WIDTH = 5e-5
"""m: light passes a narrower bump beside the pupil."""


@dataclass(frozen=True, slots=True)
class Expansion:
    """A height around points of a surface, to second order."""

    chart: tuple[Tensor, Tensor]
    """The two (...) chart coordinates of the points."""
    height: Tensor
    """(...) m"""
    first: Tensor
    """(...) m per chart unit, the slope by the first chart coordinate."""
    second: Tensor
    first_first: Tensor
    """(...) m per chart unit squared."""
    first_second: Tensor
    second_second: Tensor

    def at(self, chart: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height and the two slopes at chart coordinates nearby."""
        first, second = chart[0] - self.chart[0], chart[1] - self.chart[1]
        turn_first, turn_second = self.bend(first, second)
        return (
            self.height
            + first * (self.first + turn_first / 2)
            + second * (self.second + turn_second / 2),
            self.first + turn_first,
            self.second + turn_second,
        )

    def bend(self, first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
        """Return the changes of the two slopes for changes of the two chart coordinates."""
        return (
            self.first_first * first + self.first_second * second,
            self.first_second * first + self.second_second * second,
        )

    def __add__(self, other: "Expansion") -> "Expansion":
        """Return the sum of two heights around the same points."""
        return Expansion(
            self.chart,
            self.height + other.height,
            self.first + other.first,
            self.second + other.second,
            self.first_first + other.first_first,
            self.first_second + other.first_second,
            self.second_second + other.second_second,
        )


@dataclass(frozen=True, slots=True)
class Relief:
    """A height Phi(s) = sum a_ij exp(-|s - s_ij|^2 / (2 beta)) over a surface's chart.

    Each chart coordinate is divided by the spacing of the centres in its direction. The paper
    normalises the patch to [0, 1] instead: with n x n centres, our beta is its beta times (n -
    1)^2.
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
    """The values hold its amplitudes as NAME.amplitudes. Only the relief named relief has probes.
    """
    inset: float = 0.0
    """The prior describes the heights within the patch without this fraction of its half on each
    side (`calib.estimation.surface_prior`); with more than twelve centres, without as many spacings
    as twelve have.
    """
    anchor: tuple[float, float] | None = None
    """The chart coordinates at which the optical axis leaves the smooth cover, for `low` and
    `high`. The relief moves with that point: as the cover's numbers change, it stays where the
    camera sees it. None: it stays on the chart.
    """
    size: tuple[float, float, float] | None = None
    """How far the two chart coordinates spread in the camera's view of the smooth cover, and the m
    distance along the optical axis, for `low`, `high` and the amplitudes. A relief with an anchor
    grows with them (`calib.optics.relief_view`). None: it keeps its size.
    """

    @staticmethod
    def around(
        low: tuple[float, float],
        high: tuple[float, float],
        grid: tuple[int, int],
        anchor: tuple[float, float] | None = None,
        size: tuple[float, float, float] | None = None,
    ) -> "Relief":
        """Return the relief whose prior describes the heights from `low` to `high`. Its centres
        reach farther, as a sum of Gaussians falls off at the outermost ones.
        """
        insets = [inset_of(count, INSET) for count in grid]
        margin = [
            inset / (1 - inset) / 2 * (b - a) for a, b, inset in zip(low, high, insets, strict=True)
        ]
        return Relief(
            (low[0] - margin[0], low[1] - margin[1]),
            (high[0] + margin[0], high[1] + margin[1]),
            grid,
            inset=INSET,
            anchor=anchor,
            size=size,
        )

    @property
    def region(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The low and high chart coordinates within which the prior describes the heights."""
        insets = [inset_of(count, self.inset) for count in self.grid]
        margin = [
            inset / 2 * (b - a) for a, b, inset in zip(self.low, self.high, insets, strict=True)
        ]
        return (
            (self.low[0] + margin[0], self.low[1] + margin[1]),
            (self.high[0] - margin[0], self.high[1] - margin[1]),
        )

    @property
    def amplitudes(self) -> str:
        """The name of the amplitudes among the values."""
        return f"{self.name}.amplitudes"

    @property
    def params(self) -> tuple[Param, ...]:
        return (Param(self.amplitudes, "m", 1e-5, self.grid),)

    @property
    def spacing(self) -> tuple[float, float]:
        """The distance between neighbouring centres, in chart units."""
        first = (self.high[0] - self.low[0]) / (self.grid[0] - 1)
        second = (self.high[1] - self.low[1]) / (self.grid[1] - 1)
        return first, second

    def height(self, chart: tuple[Tensor, Tensor], values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height at two (...) chart coordinates, and its two (...) slopes, m per
        chart unit.
        """
        amplitudes = values[self.amplitudes]  # (rows, columns), or one for each point
        if (
            torch.is_grad_enabled()
            and any(coordinate.requires_grad for coordinate in chart)
            and not amplitudes.requires_grad
        ):
            height, by_first, by_second = self._height_with_slopes(amplitudes, chart)
        else:
            first, rise_first = self.gaussians(chart[0], 0)
            second, rise_second = self.gaussians(chart[1], 1)
            sums = _column_sums(amplitudes, second)
            rise_sums = _column_sums(amplitudes, rise_second)
            height = (sums * first).sum(0)
            by_first = (sums * rise_first).sum(0)
            by_second = (rise_sums * first).sum(0)
        return height, by_first, by_second

    def _height_with_slopes(
        self, amplitudes: Tensor, chart: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the same height and slopes. Their derivatives by the chart are computed in closed
        form, so that autograd stores none of the sums.
        """
        with torch.no_grad():
            at = self._expand(amplitudes, chart)
        return (
            with_slopes(at.height, *chart, at.first, at.second),
            with_slopes(at.first, *chart, at.first_first, at.first_second),
            with_slopes(at.second, *chart, at.first_second, at.second_second),
        )

    def expand(self, chart: tuple[Tensor, Tensor], values: Values) -> "Expansion":
        """Return the relief around two (...) chart coordinates, without derivatives by its
        parameters.
        """
        with torch.no_grad():
            return self._expand(values[self.amplitudes], chart)

    def _expand(self, amplitudes: Tensor, chart: tuple[Tensor, Tensor]) -> "Expansion":
        first = self._second_order_gaussians(chart[0], 0)  # (rows, 3, ...)
        second = self._second_order_gaussians(chart[1], 1)
        sums = _column_sums(amplitudes, second)  # (rows, 3, ...)
        height, by_second, second_second = (sums * first[:, :1]).sum(0)
        by_first, first_second = (sums[:, :2] * first[:, 1:2]).sum(0)
        first_first = (sums[:, 0] * first[:, 2]).sum(0)
        return Expansion(
            chart, height, by_first, by_second, first_first, first_second, second_second
        )

    def spread(self, by_probe: Tensor, chart: tuple[Tensor, Tensor], out: Tensor) -> None:
        """Write the derivatives by every amplitude, computed from those by the three probes.

        Args:
            by_probe: (M, k, 3) derivatives, in the order of PROBES.
            chart: (M,) coordinates each.
            out: (M, k, rows * columns), the result.
        """
        first, rise_first = self.gaussians(chart[0], 0)
        second, rise_second = self.gaussians(chart[1], 1)
        first = first.mT.contiguous()[:, None, :, None]  # (M, 1, rows, 1)
        rise_first = rise_first.mT.contiguous()[:, None, :, None]
        second = second.mT.contiguous()[:, None, :]  # (M, 1, columns)
        rise_second = rise_second.mT.contiguous()[:, None, :]
        level, by_first, by_second = by_probe.unsqueeze(-2).unbind(-1)  # (M, k, 1)
        by_value = (level * second + by_second * rise_second).unsqueeze(-2)  # (M, k, 1, columns)
        by_rise = (by_first * second).unsqueeze(-2)
        torch.mul(first, by_value, out=out.view(*out.shape[:-1], *self.grid)).addcmul_(
            rise_first, by_rise
        )

    def gaussians(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """Return the (n, ...) one-dimensional Gaussians of one axis, and their derivatives by the
        chart coordinate.
        """
        offsets, gaussians = self._offsets(coordinate, axis)
        return gaussians, offsets * gaussians * (-1 / (self.beta * self.spacing[axis]))

    def _second_order_gaussians(self, coordinate: Tensor, axis: int) -> Tensor:
        """Return the (n, 3, ...) Gaussians with their first and second derivatives."""
        offsets, gaussians = self._offsets(coordinate, axis)
        fall = -1 / (self.beta * self.spacing[axis])
        table = coordinate.new_empty(self.grid[axis], 3, *coordinate.shape)
        table[:, 0] = gaussians
        torch.mul(offsets, gaussians, out=table[:, 1]).mul_(fall)
        torch.mul(offsets, table[:, 1], out=table[:, 2])
        table[:, 2].add_(gaussians, alpha=1 / self.spacing[axis]).mul_(fall)
        return table

    def _offsets(self, coordinate: Tensor, axis: int) -> tuple[Tensor, Tensor]:
        """Return the (n, ...) offsets from the centres of one axis, in spacings, and the Gaussians
        of these offsets.
        """
        centres = torch.arange(self.grid[axis], dtype=coordinate.dtype, device=coordinate.device)
        offsets = (coordinate - self.low[axis]) / self.spacing[axis] - centres.reshape(
            -1, *(1,) * coordinate.ndim
        )
        return offsets, torch.exp(offsets * offsets * (-0.5 / self.beta))


@dataclass(frozen=True, slots=True)
class Bump:
    """A round bump on a surface: height exp(-r^2 / (2 width^2)), with r the distance on the glass
    from its middle.
    """

    name: str
    """The values hold NAME.height, NAME.first, NAME.second and NAME.width."""
    place: tuple[float, float]
    """Chart coordinates, from which `first` and `second` are measured."""
    metres: tuple[float, float]
    """m per unit of the two chart coordinates at this place."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            Param(f"{self.name}.height", "m", 1e-6),
            Param(f"{self.name}.first", "m", 1e-4),
            Param(f"{self.name}.second", "m", 1e-4),
            Param(f"{self.name}.width", "m", 1e-4, minimum=MIN_BUMP_WIDTH),
        )

    def height(self, chart: tuple[Tensor, Tensor], values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height at two (...) chart coordinates, and its two (...) slopes, m per
        chart unit.
        """
        at = self.expand(chart, values)
        return at.height, at.first, at.second

    def expand(self, chart: tuple[Tensor, Tensor], values: Values) -> Expansion:
        """Return the bump around two (...) chart coordinates."""
        width_squared = values[f"{self.name}.width"] ** 2
        first = (chart[0] - self.place[0]) * self.metres[0] - values[f"{self.name}.first"]
        second = (chart[1] - self.place[1]) * self.metres[1] - values[f"{self.name}.second"]
        fall = torch.exp((first**2 + second**2) / (-2 * width_squared))
        height = values[f"{self.name}.height"] * fall
        rise = -height / width_squared
        a, b = self.metres
        return Expansion(
            chart,
            height,
            rise * first * a,
            rise * second * b,
            rise * (1 - first**2 / width_squared) * a**2,
            rise * (-first * second / width_squared) * a * b,
            rise * (1 - second**2 / width_squared) * b**2,
        )


def _column_sums(amplitudes: Tensor, gaussians: Tensor) -> Tensor:
    """Return the (rows, ...) sums over the columns of the amplitudes times the second chart
    coordinate's (columns, ...) Gaussians.
    """
    if amplitudes.ndim == 2:
        sums: Tensor = torch.tensordot(amplitudes, gaussians, dims=([1], [0]))
        return sums
    return torch.einsum("...rc,c...->r...", amplitudes, gaussians)
