"""Refraction at one surface of the cover: intersect the ray with the surface, and bend the ray by
Snell's law at the normal of the hit point. A cover is an ordered tuple of such interfaces.

A surface may carry a relief. Newton's method along the ray finds the intersection with it;
the last step is differentiable, which makes the derivatives exact (implicit function theorem). A
ray that misses or is totally reflected keeps finite values and gets a failure code.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.optics.cover_frame import CoverFrame, CoverPose
from calib.optics.crossing import NEWTON_STEPS, Crossing, divisor
from calib.optics.derivatives import ByName, ByRay, add_to, by_autograd
from calib.optics.params import Param, Values
from calib.optics.rays import Rays, surface_failures
from calib.optics.relief import AMPLITUDES, PROBES, Bump, Expansion, Relief
from calib.optics.snell import Refraction
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
        if not _requires_grad(rays, values):
            return self.cross(rays, values)[0]
        frame = self.frame.at(values)
        origin, direction = frame.enter(rays.origin), frame.turn(rays.direction)
        height = self._height(values)
        distance, failed = self.surface.reach(origin, direction, height, values)
        if self.reliefs and self.exact_hit:
            distance = self._relief_distance(origin, direction, distance, height, values)
        point = origin + direction * distance
        normal = self._outward_gradient(point, values)[0].unit()
        refraction = Refraction.of(direction, normal, self._ratio(values))
        return self._leave(rays, frame, point, refraction, failed)

    def cross(self, rays: Rays, values: Values) -> tuple[Rays, Crossing]:
        """Return the same rays, and what `pull` needs."""
        frame, surface = self.frame.at(values), self.surface
        origin, direction = frame.enter(rays.origin), frame.turn(rays.direction)
        height = self._height(values)
        distance, failed = surface.reach(origin, direction, height, values)
        relief = None
        for steps in NEWTON_STEPS[: len(NEWTON_STEPS) if self.exact_hit else 1]:
            if not self.reliefs:
                break
            relief = self._expand(origin + direction * distance, values)
            for _ in range(steps if self.exact_hit else 0):
                point = origin + direction * distance
                bump, first, second = relief.at(surface.chart(point))
                gradient = surface.gradient(point, values)
                gradient = gradient - surface.chart_gradient(point, first, second)
                gap = surface.height(point, values) - height - bump
                distance = distance - gap / divisor(gradient.dot(direction))
        point = origin + direction * distance
        smooth = gradient = surface.gradient(point, values)
        if relief:
            _, first, second = relief.at(surface.chart(point))
            gradient = smooth - surface.chart_gradient(point, first, second)
        refraction = Refraction.of(direction, gradient.unit(), self._ratio(values))
        crossing = Crossing(
            surface,
            origin,
            direction,
            distance,
            point,
            relief,
            self.exact_hit,
            gradient,
            gradient if self.exact_hit else smooth,
            refraction,
        )
        return self._leave(rays, frame, point, refraction, failed), crossing

    def pull(
        self, crossing: Crossing, values: Values, by_rays: ByRay, names: frozenset[str]
    ) -> tuple[ByRay, ByName]:
        """Return the derivatives by the rays that enter and by these parameters, from the (k, M)
        derivatives by the rays that leave. Those by the outer relief's amplitudes are given by its
        `PROBES`.
        """
        frame = self.frame.at(values)
        by_point, by_bent = frame.turn(by_rays.origin), frame.turn(by_rays.direction)
        hit = crossing.pull(by_point, by_bent)
        entering = ByRay(frame.turn(hit.origin, back=True), frame.turn(hit.direction, back=True))
        by: ByName = {}
        if names & {param.name for param in self.frame.params}:
            arm = frame.turn(crossing.point, back=True)
            bent = frame.turn(crossing.refraction.bent, back=True)
            by_turn = arm.cross(by_rays.origin) + bent.cross(by_rays.direction)
            by |= self.frame.by_parameters(
                values,
                by_rays.origin - entering.origin,
                by_turn - self._entering_turn(frame, crossing, entering),
            )
        by |= self.surface.by_parameters(crossing.point, hit.height, hit.gradient)
        for name in self.thicknesses:
            add_to(by, name, -hit.height)
        index = values[self.index_outside]
        if self.index_inside:
            add_to(by, self.index_inside, hit.ratio / index)
        add_to(by, self.index_outside, -hit.ratio * self._ratio(values) / index)
        for relief in self.reliefs:
            if names & {param.name for param in relief.params}:
                by |= self._by_relief(relief, crossing, values, hit.height, hit.slopes)
        if self.relief and self.relief.anchor:
            for name, (by_first, by_second) in self._axis_derivatives(values, names).items():
                add_to(by, name, -hit.chart[0] * by_first - hit.chart[1] * by_second)
        return entering, {
            name: value for name, value in by.items() if name in names or name in PROBES
        }

    def _by_relief(
        self,
        relief: Relief | Bump,
        crossing: Crossing,
        values: Values,
        by_height: Tensor,
        by_slopes: tuple[Tensor, Tensor],
    ) -> ByName:
        """Return the derivatives by the parameters of a relief, from those by the height of the
        point over the surface and by the relief's two slopes.
        """
        by_bump = -by_height if self.exact_hit else torch.zeros_like(by_height)
        by_probes = by_bump, *by_slopes
        if isinstance(relief, Bump):
            chart = crossing.chart
            copies = {
                param.name: values[param.name].expand_as(crossing.distance)
                for param in relief.params
            }
            return by_autograd(lambda own: relief.height(chart, {**values, **own}), copies)[1](
                by_probes
            )
        if relief.amplitudes == AMPLITUDES:
            return dict(zip(PROBES, by_probes, strict=True))
        chart = (
            self.relief_chart(crossing.point, values) if relief is self.relief else crossing.chart
        )
        count = relief.grid[0] * relief.grid[1]
        columns = by_bump.new_empty(by_bump.shape[1], by_bump.shape[0], count)
        relief.spread(torch.stack(by_probes, -1).transpose(0, 1), chart, columns)
        return {relief.amplitudes: columns.transpose(0, 1)}

    def _axis_derivatives(self, values: Values, names: frozenset[str]) -> ByName:
        """Return the derivatives of `axis_chart` by the parameters, (2,) or (2, M) by name."""
        smooth = self._smooth
        _, crossing = smooth.cross(_optical_axis(values[self.index_outside]), values)
        zero = torch.zeros_like(crossing.distance)
        first, second = torch.stack([zero + 1, zero]), torch.stack([zero, zero + 1])
        none = Vector(first * 0, first * 0, first * 0)
        hit = crossing.pull(self.surface.chart_gradient(crossing.point, first, second), none)
        by = self.surface.by_parameters(crossing.point, hit.height, hit.gradient)
        for name in self.thicknesses:
            add_to(by, name, -hit.height)
        frame = smooth.frame.at(values)
        entering = ByRay(frame.turn(hit.origin, back=True), frame.turn(hit.direction, back=True))
        by |= smooth.frame.by_parameters(
            values, none - entering.origin, none - self._entering_turn(frame, crossing, entering)
        )
        return {name: value for name, value in by.items() if name in names}

    @staticmethod
    def _entering_turn(frame: CoverPose, crossing: Crossing, entering: ByRay) -> Vector:
        """Return minus the part of the derivatives by a small rotation of the frame that the rays'
        entering into the frame has.
        """
        arm = frame.turn(crossing.origin, back=True)
        direction = frame.turn(crossing.direction, back=True)
        return arm.cross(entering.origin) + direction.cross(entering.direction)

    @property
    def _smooth(self) -> "Interface":
        """The smooth surface that the optical axis meets. Further tilts, which turn the glass
        against the camera, do not count.
        """
        return replace(
            self, relief=None, extra_reliefs=(), frame=replace(self.frame, extra_tilts=())
        )

    def _height(self, values: Values) -> Tensor:
        """Return the m height above the cover's inner surface."""
        zero = torch.zeros_like(values[self.index_outside])
        return sum((values[name] for name in self.thicknesses), zero)

    def _ratio(self, values: Values) -> Tensor:
        """Return the index on the camera's side over that on the other side."""
        inside = values[self.index_inside] if self.index_inside else 1
        return inside / values[self.index_outside]

    def _leave(
        self, rays: Rays, frame: CoverPose, point: Vector, refraction: Refraction, missed: Tensor
    ) -> Rays:
        return rays.advance(
            frame.leave(point),
            frame.turn(refraction.bent, back=True),
            (missed, self.failures[0]),
            (refraction.reflected, self.failures[1]),
        )

    def _expand(self, point: Vector, values: Values) -> Expansion:
        """Return the sum of all reliefs around points, over the surface's chart."""
        on_surface = self.surface.chart(point)
        expansions = [
            relief.expand(
                self.relief_chart(point, values) if relief is self.relief else on_surface, values
            )
            for relief in self.reliefs
        ]
        total = replace(expansions[0], chart=on_surface)
        for expansion in expansions[1:]:
            total = total + expansion
        return total

    def axis_chart(self, values: Values) -> tuple[Tensor, Tensor]:
        """Return the two chart coordinates at which the camera's z axis meets the smooth surface.
        Further tilts, which turn the glass against the camera, do not count.
        """
        return self._smooth.cross(_optical_axis(values[self.index_outside]), values)[1].chart

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
        return self.surface.height(point, values) - height - bump, divisor(gradient.dot(direction))


def _optical_axis(like: Tensor) -> Rays:
    """Return the ray along the camera's z axis, as a bundle of the tensor's shape."""
    zero = torch.zeros_like(like)
    failure = torch.zeros_like(like, dtype=torch.uint8)
    return Rays(Vector(zero, zero, zero), Vector(zero, zero, zero + 1), failure)


def _requires_grad(rays: Rays, values: Values) -> bool:
    """Return True if torch records what happens to these rays."""
    components = (rays.origin, rays.direction)
    return torch.is_grad_enabled() and (
        any(t.requires_grad for v in components for t in (v.x, v.y, v.z))
        or any(value.requires_grad for value in values.values())
    )


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
