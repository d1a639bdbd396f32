"""Crossing one surface of the cover: hit it, bend at its normal, leave a mark where that fails."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.params import Param, Values
from calib.optics.rays import MISSED_INNER, MISSED_OUTER, REFLECTED_INNER, REFLECTED_OUTER, Rays, unit
from calib.optics.relief import Relief
from calib.optics.snell import refract
from calib.optics.surface import Surface

RELIEF_STEPS = 4
"""Newton steps onto an uneven surface. Each squares the error; from a perfect surface, 1e-4 m away, three reach 1e-16 m."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Where the cover stands: its frame's origin in the camera frame, and its rotation vector. Parameter names; absent means zero."""

    origin: tuple[str | None, str | None, str | None] = (None, None, None)
    tilt: tuple[str | None, str | None, str | None] = (None, None, None)

    @property
    def params(self) -> tuple[Param, ...]:
        return (*(Param(n, "m", 1e-3) for n in self.origin if n), *(Param(n, "rad", 1e-2) for n in self.tilt if n))

    def pose(self, values: Values, like: Tensor) -> tuple[Tensor, Tensor]:
        """(3, 3) R and (3) m t of T_camera_cover: x_camera = R x_cover + t."""
        zero = torch.zeros((), dtype=like.dtype, device=like.device)
        t = torch.stack([values[name] if name else zero for name in self.origin])
        w = torch.stack([values[name] if name else zero for name in self.tilt])
        return rotation.matrix(w), t


@dataclass(frozen=True, slots=True)
class Interface:
    """One surface of the cover, inner (into the glass) or outer (out of it), as a stage of the ray path."""

    name: Literal["inner", "outer"]
    surface: Surface
    frame: Frame
    relief: Relief | None = None
    exact_hit: bool = True
    """Whether the relief moves the hit point, or only bends the normal as in the paper."""

    @property
    def params(self) -> tuple[Param, ...]:
        own = [Param("cover.refractive_index", "", 1e-2)]
        if self.name == "outer":
            own += [Param("cover.thickness", "m", 1e-3), Param("cover.outside_index", "", 1e-2)]
        return (*self.surface.params, *self.frame.params, *own, *(self.relief.params if self.relief else ()))

    def __call__(self, rays: Rays, values: Values) -> Rays:
        """Rays before the surface to rays that start on it, bent."""
        turn, shift = self.frame.pose(values, rays.origin)
        origin, direction = (rays.origin - shift) @ turn, rays.direction @ turn  # into the cover's frame
        glass = values["cover.refractive_index"]
        if self.name == "inner":
            height, ratio = torch.zeros_like(glass), 1 / glass
            codes = MISSED_INNER, REFLECTED_INNER
        else:
            height, ratio = values["cover.thickness"], glass / values["cover.outside_index"]
            codes = MISSED_OUTER, REFLECTED_OUTER
        distance, missed = self.surface.reach(origin, direction, height, values)
        point = origin + distance.unsqueeze(-1) * direction
        normal = self.surface.gradient(point, values)
        if self.relief:
            if self.exact_hit:
                point = self._onto_relief(origin, direction, distance, height, values)
                normal = self.surface.gradient(point, values)
            _, slopes = self.relief.height(self.surface.chart(point), values)
            normal = normal - (slopes.unsqueeze(-1) * self.surface.chart_gradient(point)).sum(-2)
        bent, reflected = refract(direction, -unit(normal), ratio)
        moved = Rays(point @ turn.mT + shift, bent @ turn.mT, rays.fail(missed, codes[0]))
        return Rays(moved.origin, moved.direction, moved.fail(reflected, codes[1]))

    def _onto_relief(self, origin: Tensor, direction: Tensor, start: Tensor, height: Tensor, values: Values) -> Tensor:
        """The (..., 3) point where the ray meets the uneven surface, with exact first derivatives."""
        assert self.relief is not None
        still = {name: values[name].detach() for name in (p.name for p in self.params)}
        distance, origin_, direction_ = start.detach(), origin.detach(), direction.detach()
        for _ in range(RELIEF_STEPS):
            above, slope = self._above(origin_ + distance.unsqueeze(-1) * direction_, direction_, height.detach(), still)
            distance = distance - above / slope
        # Newton's last step, taken with derivatives, is the implicit function theorem.
        above, _ = self._above(origin + distance.unsqueeze(-1) * direction, direction, height, values)
        return origin + (distance - above / slope).unsqueeze(-1) * direction

    def _above(self, point: Tensor, direction: Tensor, height: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m above the uneven surface, and its (...) change per metre along the ray, kept away from zero."""
        assert self.relief is not None
        bump, slopes = self.relief.height(self.surface.chart(point), values)
        normal = self.surface.gradient(point, values) - (slopes.unsqueeze(-1) * self.surface.chart_gradient(point)).sum(-2)
        slope = (normal * direction).sum(-1)
        return self.surface.height(point, values) - height - bump, torch.where(slope.abs() < 1e-3, torch.ones_like(slope), slope)
