"""Refraction at one surface of the cover: intersect the ray with it, bend the ray by Snell's law at
the normal there.

The outer surface may carry a relief. Its intersection is found by Newton's method along the ray;
the last step is taken with derivatives, which makes them exact (implicit function theorem). A ray
that misses or is totally reflected keeps finite values and a failure code.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from calib.optics.cover_frame import CoverFrame
from calib.optics.params import Param, Values
from calib.optics.rays import MISSED_INNER, MISSED_OUTER, REFLECTED_INNER, REFLECTED_OUTER, Rays
from calib.optics.relief import Relief
from calib.optics.snell import refract
from calib.optics.surface import Surface
from calib.optics.vector import Vector

RELIEF_STEPS = 2
"""Newton steps onto an uneven surface before the differentiable one. Each about squares the error:
from a perfect surface 1e-4 m away, over bumps 3 mm wide, 5e-8 m, then 1e-14 m.
"""

THINNEST = 5e-5
"""m: session.yaml takes no thinner glass."""


@dataclass(frozen=True, slots=True)
class Interface:
    """One surface of the cover, inner (into the glass) or outer (out of it), as a stage of the ray
    path.
    """

    name: Literal["inner", "outer"]
    surface: Surface
    frame: CoverFrame
    relief: Relief | None = None
    exact_hit: bool = True
    """Whether the relief moves the hit point, or only bends the normal as in the paper."""
    more: tuple[Relief, ...] = ()
    """Added to the relief."""

    @property
    def reliefs(self) -> tuple[Relief, ...]:
        return (*((self.relief,) if self.relief else ()), *self.more)

    @property
    def params(self) -> tuple[Param, ...]:
        own = [Param("cover.refractive_index", "", 1e-2)]
        if self.name == "outer":
            own += [
                Param("cover.thickness", "m", 1e-3, least=THINNEST),
                Param("cover.outside_index", "", 1e-2),
            ]
        return (
            *self.surface.params,
            *self.frame.params,
            *own,
            *(param for relief in self.reliefs for param in relief.params),
        )

    def __call__(self, rays: Rays, values: Values) -> Rays:
        """Rays before the surface to rays that start on it, bent."""
        frame = self.frame.at(values)
        origin, direction = frame.enter(rays.origin), frame.turn(rays.direction)
        glass = values["cover.refractive_index"]
        if self.name == "inner":
            height, ratio = torch.zeros_like(glass), 1 / glass
            missed_code, reflected_code = MISSED_INNER, REFLECTED_INNER
        else:
            height, ratio = values["cover.thickness"], glass / values["cover.outside_index"]
            missed_code, reflected_code = MISSED_OUTER, REFLECTED_OUTER
        distance, missed = self.surface.reach(origin, direction, height, values)
        if self.reliefs and self.exact_hit:
            distance = self._onto_relief(origin, direction, distance, height, values)
        point = origin + direction * distance
        bent, reflected = refract(direction, self._outwards(point, values)[0].unit(), ratio)
        return rays.moved(
            frame.leave(point),
            frame.turn(bent, back=True),
            (missed, missed_code),
            (reflected, reflected_code),
        )

    def _outwards(self, point: Vector, values: Values) -> tuple[Vector, Tensor | float]:
        """The gradient of the height above the surface, relief included, and the relief's (...) m
        there.
        """
        gradient = self.surface.gradient(point, values)
        if not self.reliefs:
            return gradient, 0.0
        chart = self.surface.chart(point)
        bump, first, second = (
            sum(parts[1:], parts[0])
            for parts in zip(*(r.height(chart, values) for r in self.reliefs), strict=True)
        )
        return gradient - self.surface.chart_gradient(point, first, second), bump

    def _onto_relief(
        self, origin: Vector, direction: Vector, start: Tensor, height: Tensor, values: Values
    ) -> Tensor:
        """The (...) m along the ray to the uneven surface, with exact first derivatives."""
        still = {param.name: values[param.name].detach() for param in self.params}
        origin_, direction_, height_, distance = (
            origin.detach(),
            direction.detach(),
            height.detach(),
            start.detach(),
        )
        for _ in range(RELIEF_STEPS):
            above, slope = self._above(origin_ + direction_ * distance, direction_, height_, still)
            distance = distance - above / slope
        # Newton's last step, taken with derivatives, is the implicit function theorem.
        above, slope = self._above(origin + direction * distance, direction, height, values)
        return distance - above / slope.detach()

    def _above(
        self, point: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        """(...) m above the uneven surface, and its (...) change per metre along the ray, kept away
        from zero.
        """
        gradient, bump = self._outwards(point, values)
        slope = gradient.dot(direction)
        safe = torch.where(slope.abs() < 1e-3, torch.ones_like(slope), slope)
        return self.surface.height(point, values) - height - bump, safe
