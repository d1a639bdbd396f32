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
from calib.optics.crossing import NEWTON_STEPS, Crossing, HitDerivatives, divisor
from calib.optics.derivatives import ByName, ByRay, add_to, by_autograd
from calib.optics.params import Param, Values
from calib.optics.rays import Rays, surface_failures
from calib.optics.relief import AMPLITUDES, PROBES, Bump, Expansion, Relief
from calib.optics.relief_view import ReliefPlace, ReliefView, view_rays, view_weights
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
        frame = self.frame.at(values)
        local = frame.enter_rays(rays)
        if not records(rays, values):
            return frame.leave_rays(self.cross(local, values)[0])
        height = self._height(values)
        distance, failed = self.surface.reach(local.origin, local.direction, height, values)
        if self.reliefs and self.exact_hit:
            distance = self._relief_distance(
                local.origin, local.direction, distance, height, values
            )
        point = local.origin + local.direction * distance
        normal = self._outward_gradient(point, values)[0].unit()
        refraction = Refraction.of(local.direction, normal, self._ratio(values))
        return frame.leave_rays(self._refracted(local, point, refraction, failed))

    def cross(self, rays: Rays, values: Values) -> tuple[Rays, Crossing]:
        """Turn rays in the cover's frame into the refracted rays; return with them what `pull`
        needs.
        """
        surface, origin, direction = self.surface, rays.origin, rays.direction
        height = self._height(values)
        distance, failed = surface.reach(origin, direction, height, values)
        place = self.relief_place(values)
        relief, outer = None, None
        for steps in NEWTON_STEPS[: len(NEWTON_STEPS) if self.exact_hit else 1]:
            if not self.reliefs:
                break
            reached = surface.chart(origin + direction * distance)
            relief, outer = self._expand(reached, place, values)
            for _ in range(steps if self.exact_hit else 0):
                point = origin + direction * distance
                bump, first, second = relief.at(surface.chart(point))
                gradient = surface.gradient(point, values)
                gradient = gradient - surface.chart_gradient(point, first, second)
                gap = surface.height(point, values) - height - bump
                distance = distance - gap / divisor(gradient.dot(direction))
        point = origin + direction * distance
        smooth = gradient = surface.gradient(point, values)
        chart, slopes = None, None
        if relief:
            chart = surface.chart(point)
            _, *slopes = relief.at(chart)
            gradient = smooth - surface.chart_gradient(point, *slopes)
        inverse = gradient.dot(gradient).rsqrt()
        refraction = Refraction.of(direction, gradient * inverse, self._ratio(values))
        crossing = Crossing(
            surface=surface,
            entered=rays,
            distance=distance,
            point=point,
            relief=relief,
            chart=chart,
            outer=(place, outer) if place and outer else None,
            slopes=(slopes[0], slopes[1]) if slopes else None,
            exact_hit=self.exact_hit,
            inverse_gradient=inverse,
            hit_gradient=gradient if self.exact_hit else smooth,
            refraction=refraction,
        )
        return self._refracted(rays, point, refraction, failed), crossing

    def pull(
        self, crossing: Crossing, values: Values, by_rays: ByRay, names: frozenset[str]
    ) -> tuple[ByRay, ByName]:
        """Return the derivatives by the rays that enter and by these parameters, from the (k, M)
        derivatives by the rays that leave, all in the cover's frame; those by the frame are not
        among them. Those by the outer relief's amplitudes are given by its `PROBES`.
        """
        hit = crossing.pull(by_rays, values)
        by = self.surface.by_parameters(crossing.point, hit.height, hit.gradient, values)
        for name in self.thicknesses:
            add_to(by, name, -hit.height)
        index = values[self.index_outside]
        if self.index_inside:
            add_to(by, self.index_inside, hit.ratio / index)
        add_to(by, self.index_outside, -hit.ratio * crossing.refraction.ratio / index)
        by = {name: value for name, value in by.items() if name in names}
        for relief in self.reliefs:
            if names & {param.name for param in relief.params}:
                by |= self._by_relief(relief, crossing, values, hit)
        if crossing.outer and crossing.outer[0].view:
            assert crossing.chart
            place, outer = crossing.outer
            by_view = place.pull(outer, crossing.chart, self._by_bump(hit), hit.slopes)
            for name, rows in self.view_derivatives(values, names).items():
                terms = (part * row for part, row in zip(by_view, rows, strict=True))
                add_to(by, name, sum(terms, torch.zeros_like(hit.height)))
        return hit.rays, by

    def _by_relief(
        self, relief: Relief | Bump, crossing: Crossing, values: Values, hit: HitDerivatives
    ) -> ByName:
        """Return the derivatives by the parameters of a relief."""
        by_probes: tuple[Tensor, ...] = (self._by_bump(hit), *hit.slopes)
        assert crossing.chart
        if isinstance(relief, Bump):
            chart = crossing.chart
            copies = {
                param.name: values[param.name].expand_as(crossing.distance)
                for param in relief.params
            }
            return by_autograd(lambda copy: relief.height(chart, {**values, **copy}), copies)[1](
                by_probes
            )
        if relief.amplitudes == AMPLITUDES:
            return dict(zip(PROBES, by_probes, strict=True))
        chart = crossing.chart
        if relief is self.relief and crossing.outer:
            chart = crossing.relief_chart
            factors = crossing.outer[0].factors
            by_probes = tuple(f * by for f, by in zip(factors, by_probes, strict=True))
        count = relief.grid[0] * relief.grid[1]
        outputs, rows = hit.height.shape
        columns = hit.height.new_empty(rows, outputs, count)
        relief.spread(torch.stack(by_probes, -1).transpose(0, 1), chart, columns)
        shape = (outputs, rows, *relief.grid)
        return {relief.amplitudes: columns.transpose(0, 1).reshape(shape)}

    def _by_bump(self, hit: HitDerivatives) -> Tensor:
        """Return the (k, M) derivatives by the height of the relief at the hits."""
        return -hit.height if self.exact_hit else torch.zeros_like(hit.height)

    def view_derivatives(self, values: Values, names: frozenset[str]) -> ByName:
        """Return the derivatives of the `relief_view` by the parameters, (5, 1) or (5, M) by name:
        those of its middle, of the logarithms of its spreads and of that of its distance.
        """
        smooth = self._smooth
        pose = smooth.frame.at(values)
        entered = pose.enter_rays(view_rays(values[self.index_outside]))
        _, crossing = smooth.cross(entered, values)
        first, second = self.surface.chart(crossing.point)
        zero = torch.zeros_like(first + second + crossing.distance)  # (5, M)
        weights = view_weights((first + zero, second + zero))  # (5 numbers, 5 rays, M) each
        by_point = self.surface.chart_gradient(crossing.point, *weights)
        along = torch.zeros_like(weights[0])
        along[-1, 0] = 1 / crossing.distance[0]
        outwards = entered.direction * along
        none = Vector(*(torch.zeros_like(along),) * 3)
        by_rays, by = smooth.pull(crossing, values, ByRay(by_point + outwards, none), names)
        by_rays = replace(by_rays, origin=by_rays.origin - outwards)
        _, by_frame = smooth.frame.pull_entering(values, pose, entered, by_rays, names)
        for name, value in by_frame.items():
            add_to(by, name, value)
        return {name: value.sum(1) for name, value in by.items()}

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
        numerator = values[self.index_inside] if self.index_inside else 1
        return numerator / values[self.index_outside]

    def _refracted(self, rays: Rays, point: Vector, refraction: Refraction, failed: Tensor) -> Rays:
        return rays.advance(
            point,
            refraction.bent,
            (failed, self.failures[0]),
            (refraction.reflected, self.failures[1]),
        )

    def _expand(
        self, chart: tuple[Tensor, Tensor], place: ReliefPlace | None, values: Values
    ) -> tuple[Expansion, Expansion | None]:
        """Return the sum of all reliefs around points of the surface's chart, and the part of the
        outer one.
        """
        expansions = [relief.expand(chart, values) for relief in self.extra_reliefs]
        outer = None
        if place:
            outer = place.to_chart(place.relief.expand(place.to_relief(chart), values), chart)
            expansions = [outer, *expansions]
        total = expansions[0]
        for expansion in expansions[1:]:
            total = total + expansion
        return total, outer

    def relief_view(self, values: Values) -> ReliefView:
        """Return the camera's view of the smooth surface, without further tilts, which turn the
        glass against the camera.
        """
        smooth = self._smooth
        rays = smooth.frame.at(values).enter_rays(view_rays(values[self.index_outside]))
        crossing = smooth.cross(rays, values)[1]
        return ReliefView.of(self.surface.chart(crossing.point), crossing.distance)

    def relief_chart(self, point: Vector, values: Values) -> tuple[Tensor, Tensor]:
        """Return the two (...) coordinates of its own at which the relief has its height at points
        in the cover's frame.
        """
        place = self.relief_place(values)
        chart = self.surface.chart(point)
        return place.to_relief(chart) if place else chart

    def relief_height(self, point: Vector, values: Values) -> Tensor:
        """Return the (...) m height of the relief at points in the cover's frame."""
        place = self.relief_place(values)
        assert place
        return place.height(self.surface.chart(point), values)[0]

    def relief_place(self, values: Values) -> ReliefPlace | None:
        """Return the place of the relief; None without one."""
        if not self.relief:
            return None
        return ReliefPlace(self.relief, self.relief_view(values) if self.relief.anchor else None)

    def _outward_gradient(self, point: Vector, values: Values) -> tuple[Vector, Tensor | float]:
        """Return the gradient of the height above the surface with its relief, and the relief's
        (...) m height, at a point.
        """
        gradient = self.surface.gradient(point, values)
        if not self.reliefs:
            return gradient, 0.0
        chart = self.surface.chart(point)
        parts = [relief.height(chart, values) for relief in self.extra_reliefs]
        if place := self.relief_place(values):
            parts.append(place.height(chart, values))
        bump = sum((height for height, _, _ in parts), torch.zeros_like(chart[0]))
        first = sum((slope for _, slope, _ in parts), torch.zeros_like(chart[0]))
        second = sum((slope for _, _, slope in parts), torch.zeros_like(chart[0]))
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


def records(rays: Rays, values: Values) -> bool:
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

    The first one stands in air. What is outside of one is inside the next.
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
