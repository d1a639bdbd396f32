"""Refraction at one surface of the cover: intersect the ray with the surface, and bend the ray by
Snell's law at the normal of the hit point. A cover is an ordered tuple of such interfaces.

A surface may carry a relief. Newton's method along the ray finds the intersection with it;
the last step is differentiable, which makes the derivatives exact (implicit function theorem). A
ray that misses or is totally reflected keeps finite values and gets a failure code.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.optics.cover_frame import CoverFrame
from calib.optics.params import Param, Values
from calib.optics.rays import Rays, surface_failures
from calib.optics.relief import Bump, Relief
from calib.optics.snell import refract
from calib.optics.surface import Surface
from calib.optics.vector import Vector

RELIEF_STEPS = 2
"""Newton steps onto an uneven surface before the differentiable step. Each step about squares the
error: from a perfect surface 1e-4 m away, over bumps 3 mm wide, 5e-8 m, then 1e-14 m.
"""

MIN_THICKNESS = 5e-5
"""m: session.yaml accepts no thinner glass."""


@dataclass(frozen=True, slots=True)
class Interface:
    """One surface of the cover as a stage of the ray path. It parts two media."""

    surface: Surface
    frame: CoverFrame
    thicknesses: tuple[str, ...]
    """The names of the layers' thicknesses whose sum is its height above its cover's inner surface;
    none for that surface itself.
    """
    index_inside: str | None
    """The name of the index on the camera's side. None: air, whose index is 1."""
    index_outside: str
    """The name of the index on the other side."""
    failures: tuple[int, int]
    """The failure of a ray that misses it, and of one that it reflects totally."""
    relief: Relief | None = None
    exact_hit: bool = True
    """True if the relief moves the hit point; False if it only tilts the normal, as in the paper.
    """
    extra_reliefs: tuple[Relief | Bump, ...] = ()
    """Further reliefs; the surface carries the sum of all."""

    @property
    def reliefs(self) -> tuple[Relief | Bump, ...]:
        return (*((self.relief,) if self.relief else ()), *self.extra_reliefs)

    @property
    def params(self) -> tuple[Param, ...]:
        names = (self.index_inside, self.index_outside)
        indices = [Param(name, "", 1e-2) for name in names if name]
        lengths = (Param(name, "m", 1e-3, minimum=MIN_THICKNESS) for name in self.thicknesses)
        return (
            *self.surface.params,
            *self.frame.params,
            *indices[:1],
            *lengths,
            *indices[1:],
            *(param for relief in self.reliefs for param in relief.params),
        )

    def __call__(self, rays: Rays, values: Values) -> Rays:
        """Turn rays that travel towards the surface into the refracted rays that start on it."""
        frame = self.frame.at(values)
        origin, direction = frame.enter(rays.origin), frame.turn(rays.direction)
        index = values[self.index_outside]
        ratio = (values[self.index_inside] if self.index_inside else 1) / index
        height = sum((values[name] for name in self.thicknesses), torch.zeros_like(index))
        distance, failed = self.surface.reach(origin, direction, height, values)
        if self.reliefs and self.exact_hit:
            distance = self._relief_distance(origin, direction, distance, height, values)
        point = origin + direction * distance
        refracted, reflected = refract(
            direction, self._outward_gradient(point, values)[0].unit(), ratio
        )
        return rays.advance(
            frame.leave(point),
            frame.turn(refracted, back=True),
            (failed, self.failures[0]),
            (reflected, self.failures[1]),
        )

    def axis_chart(self, values: Values) -> tuple[Tensor, Tensor]:
        """Return the two chart coordinates at which the camera's z axis meets the smooth surface.
        Further tilts, which turn the glass against the camera, do not count.
        """
        frame = replace(self.frame, extra_tilts=()).at(values)
        zero = torch.zeros_like(values[self.index_outside])
        origin = frame.enter(Vector(zero, zero, zero))
        direction = frame.turn(Vector(zero, zero, zero + 1))
        height = sum((values[name] for name in self.thicknesses), zero)
        distance, _ = self.surface.reach(origin, direction, height, values)
        return self.surface.chart(origin + direction * distance)

    def relief_chart(self, point: Vector, values: Values) -> tuple[Tensor, Tensor]:
        """Return the two (...) chart coordinates at which the relief has its height at points in
        the cover's frame.
        """
        first, second = self.surface.chart(point)
        if not self.relief or not self.relief.anchor:
            return first, second
        axis_first, axis_second = self.axis_chart(values)
        anchor_first, anchor_second = self.relief.anchor
        return first - (axis_first - anchor_first), second - (axis_second - anchor_second)

    def _outward_gradient(self, point: Vector, values: Values) -> tuple[Vector, Tensor | float]:
        """Return the gradient of the height above the surface with its relief, and the relief's
        (...) m height, at a point.
        """
        gradient = self.surface.gradient(point, values)
        if not self.reliefs:
            return gradient, 0.0
        chart = self.relief_chart(point, values)
        bump, first, second = self.reliefs[0].height(chart, values)
        for relief in self.reliefs[1:]:
            height, by_first, by_second = relief.height(self.surface.chart(point), values)
            bump, first, second = bump + height, first + by_first, second + by_second
        return gradient - self.surface.chart_gradient(point, first, second), bump

    def _relief_distance(
        self, origin: Vector, direction: Vector, start: Tensor, height: Tensor, values: Values
    ) -> Tensor:
        """Return the (...) m distance along the ray to the uneven surface, with exact first
        derivatives.
        """
        constants = {param.name: values[param.name].detach() for param in self.params}
        fixed_origin = origin.detach()
        fixed_direction = direction.detach()
        fixed_height = height.detach()
        distance = start.detach()
        for _ in range(RELIEF_STEPS):
            point = fixed_origin + fixed_direction * distance
            gap, slope = self._gap(point, fixed_direction, fixed_height, constants)
            distance = distance - gap / slope
        # Newton's last step, taken with derivatives, is the implicit function theorem.
        gap, slope = self._gap(origin + direction * distance, direction, height, values)
        return distance - gap / slope.detach()

    def _gap(
        self, point: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        """Return the (...) m height of a point above the uneven surface, and the change of this
        height per metre along the ray. That change is never close to zero.
        """
        gradient, bump = self._outward_gradient(point, values)
        slope = gradient.dot(direction)
        safe = torch.where(slope.abs() < 1e-3, torch.ones_like(slope), slope)
        return self.surface.height(point, values) - height - bump, safe


@dataclass(frozen=True, slots=True)
class SmoothCover:
    """One cover: concentric or parallel surfaces with layers of glass between them."""

    surface: Surface
    frame: CoverFrame
    layers: int = 1

    @property
    def thicknesses(self) -> tuple[str, ...]:
        """The names of the layers' thicknesses, from the inside out."""
        return tuple(self.surface.names.thickness(i + 1) for i in range(self.layers))

    @property
    def indices(self) -> tuple[str, ...]:
        """The names of the layers' indices, and of the index of what is outside."""
        names = self.surface.names
        return (
            *(names.refractive_index(i + 1) for i in range(self.layers)),
            names.outside_index,
        )


def interfaces_of(*covers: SmoothCover) -> tuple[Interface, ...]:
    """Return the interfaces of covers one in front of the other, all from the camera outwards.

    The first one stands in air. What is outside of one is inside of the next.
    """
    surfaces = sum(cover.layers + 1 for cover in covers)
    interfaces: list[Interface] = []
    index_inside: str | None = None
    for cover in covers:
        for layer, index_outside in enumerate(cover.indices):
            failures = surface_failures(len(interfaces) + 1, surfaces)
            thicknesses = cover.thicknesses[:layer]
            interfaces.append(
                Interface(
                    surface=cover.surface,
                    frame=cover.frame,
                    thicknesses=thicknesses,
                    index_inside=index_inside,
                    index_outside=index_outside,
                    failures=failures,
                )
            )
            index_inside = index_outside
    return tuple(interfaces)
