"""The camera's view of the smooth cover, to which a relief is tied.

Views of a board show how each pixel's ray is bent. They hardly show how far away the glass is that
bends it. So as the numbers of a cover change during a fit, its relief stays where the camera sees
it: it moves with the point at which the optical axis leaves the smooth cover, and it grows with the
distance of the glass, in width and in height, as a shadow does. Its slopes stay. A relief of a
fixed size would be more probable on glass farther away, where the same picture needs broader bumps,
and its prior would pull the numbers there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.optics.params import Values
from calib.optics.rays import Rays
from calib.optics.relief import Expansion, Relief
from calib.optics.vector import Vector

SIDE = 0.2
"""The slope to the optical axis of the four rays that show the size of the view."""
ROWS = 5
"""The rays of a view: the optical axis, then two on either side of it. A view has as many numbers.
"""


@dataclass(frozen=True, slots=True)
class ReliefView:
    """The smooth cover as the camera sees it."""

    middle: tuple[Tensor, Tensor]
    """The two (...) chart coordinates at which the optical axis leaves the cover."""
    spread: tuple[Tensor, Tensor]
    """The root mean squares of the (...) differences of the side rays' chart coordinates from
    them.
    """
    distance: Tensor
    """(...) m along the optical axis."""

    @staticmethod
    def of(chart: tuple[Tensor, Tensor], distance: Tensor) -> ReliefView:
        """Return the view from the chart coordinates and distances of its (5, M) rays."""
        spread = tuple(((c[1:] - c[0]) ** 2).mean(0).sqrt() for c in chart)
        return ReliefView((chart[0][0], chart[1][0]), (spread[0], spread[1]), distance[0])

    @property
    def anchor(self) -> tuple[float, float]:
        """The middle, as a relief keeps it."""
        return float(self.middle[0]), float(self.middle[1])

    @property
    def size(self) -> tuple[float, float, float]:
        """The spreads and the distance, as a relief keeps them."""
        return float(self.spread[0]), float(self.spread[1]), float(self.distance)


def view_rays(like: Tensor) -> Rays:
    """Return the (5, 1) rays of a view in the camera frame. Values may differ along the last axis.

    Args:
        like: a tensor of the rays' type.
    """
    x, y = like.new_tensor([[0, SIDE, -SIDE, 0, 0], [0, 0, 0, SIDE, -SIDE]]).unsqueeze(-1)
    length = (1 + x**2 + y**2).rsqrt()
    zero = torch.zeros_like(x)
    failure = torch.zeros_like(x, dtype=torch.uint8)
    return Rays(Vector(zero, zero, zero), Vector(x * length, y * length, length), failure)


def view_weights(chart: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Return the (5, 5, ...) derivatives of a view's middle, of the logarithms of its spreads and
    of that of its distance, by the first and by the second chart coordinate of its (5, ...) rays.
    """
    weights = []
    for place, c in enumerate(chart):
        by = torch.zeros(ROWS, *c.shape, dtype=c.dtype)
        by[place, 0] = 1
        side = c[1:] - c[0]
        by[2 + place, 1:] = side / (side**2).sum(0)
        by[2 + place, 0] = -by[2 + place, 1:].sum(0)
        weights.append(by)
    return weights[0], weights[1]


@dataclass(frozen=True, slots=True)
class ReliefPlace:
    """The place of a relief on the chart, in the camera's view."""

    relief: Relief
    view: ReliefView | None
    """None for a relief without an anchor, which stays on the chart."""

    @property
    def stretch(self) -> tuple[Tensor | float, Tensor | float]:
        """The relief's own coordinates by the chart's, along each of them."""
        if not (self.view and self.relief.size):
            return 1.0, 1.0
        first, second, _ = self.relief.size
        return first / self.view.spread[0], second / self.view.spread[1]

    @property
    def growth(self) -> Tensor | float:
        """The height over that of the relief's own size."""
        if not (self.view and self.relief.size):
            return 1.0
        return self.view.distance / self.relief.size[2]

    @property
    def factors(self) -> tuple[Tensor | float, Tensor | float, Tensor | float]:
        """The factors of the height and of its two slopes on the chart."""
        first, second = self.stretch
        return self.growth, self.growth * first, self.growth * second

    def to_relief(self, chart: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Return the relief's own coordinates of (...) chart coordinates."""
        if not self.view:
            return chart
        assert self.relief.anchor
        middle, anchor, stretch = self.view.middle, self.relief.anchor, self.stretch
        return (
            anchor[0] + (chart[0] - middle[0]) * stretch[0],
            anchor[1] + (chart[1] - middle[1]) * stretch[1],
        )

    def height(self, chart: tuple[Tensor, Tensor], values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the relief's (...) m height at two (...) chart coordinates, and its two (...)
        slopes, m per chart unit.
        """
        growth, first, second = self.factors
        height, by_first, by_second = self.relief.height(self.to_relief(chart), values)
        return growth * height, first * by_first, second * by_second

    def to_chart(self, expansion: Expansion, chart: tuple[Tensor, Tensor]) -> Expansion:
        """Return the expansion on the chart of one in the relief's own coordinates."""
        growth, first, second = self.factors
        by_first, by_second = self.stretch
        return Expansion(
            chart,
            growth * expansion.height,
            first * expansion.first,
            second * expansion.second,
            first * by_first * expansion.first_first,
            first * by_second * expansion.first_second,
            second * by_second * expansion.second_second,
        )

    def pull(
        self,
        expansion: Expansion,
        chart: tuple[Tensor, Tensor],
        by_height: Tensor,
        by_slopes: tuple[Tensor, Tensor],
    ) -> tuple[Tensor, ...]:
        """Return the (k, M) derivatives by the two coordinates of the view's middle, the logarithms
        of its spreads and that of its distance, from those by the relief's height and slopes at M
        points.

        Args:
            expansion: the relief on the chart, next to the points.
        """
        assert self.view
        height, *slopes = expansion.at(chart)
        by_chart = [
            turn + by_height * slope
            for turn, slope in zip(expansion.bend(*by_slopes), slopes, strict=True)
        ]
        by_middle = [-by for by in by_chart]
        if not self.relief.size:
            return *by_middle, *(torch.zeros_like(by_height),) * 3
        by_spread = [
            -by * (c - middle) - by_slope * slope
            for by, c, middle, by_slope, slope in zip(
                by_chart, chart, self.view.middle, by_slopes, slopes, strict=True
            )
        ]
        by_distance = by_height * height + by_slopes[0] * slopes[0] + by_slopes[1] * slopes[1]
        return *by_middle, *by_spread, by_distance


def described_at(
    relief: Relief, anchor: tuple[float, float], size: tuple[float, float, float]
) -> Relief:
    """Return the same relief, described on the chart where the camera's view of the cover has this
    middle and this size. Its amplitudes are still those of its own distance.
    """
    if not relief.anchor:
        return relief
    described = relief.size or size
    ends = [
        [
            middle + (end - described_middle) * spread / described_spread
            for end, described_middle, middle, spread, described_spread in zip(
                place, relief.anchor, anchor, size, described, strict=False
            )
        ]
        for place in (relief.low, relief.high)
    ]
    return replace(
        relief,
        low=(ends[0][0], ends[0][1]),
        high=(ends[1][0], ends[1][1]),
        anchor=anchor,
        size=(size[0], size[1], described[2]) if relief.size else None,
    )
