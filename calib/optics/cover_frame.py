"""The pose of the cover in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from calib.optics.derivatives import ByName, ByRay, add_to
from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.optics.rotation import Rotation, left_jacobian
from calib.optics.vector import Vector

Names = tuple[str | None, str | None, str | None]


@dataclass(frozen=True, slots=True)
class CoverFrame:
    """T_camera_cover from named values: x_camera = R x_cover + t.

    A name that is None stands for zero.
    """

    origin: Names = (None, None, None)
    """t, m: the cover's origin in the camera frame."""
    tilt: Names = (None, None, None)
    """R's rotation vector, rad: the cover is turned about its own origin."""
    extra_tilts: tuple[Names, ...] = ()
    """Further rotation vectors, rad, each about the axes of the frame that the ones before it have
    turned: R = R(tilt) R(first) R(second) ...
    """

    @property
    def params(self) -> tuple[Param, ...]:
        turns = (n for names in (self.tilt, *self.extra_tilts) for n in names if n)
        return (
            *(Param(n, "m", 1e-3) for n in self.origin if n),
            *(Param(n, "rad", 1e-2) for n in turns),
        )

    def at(self, values: Values) -> CoverPose:
        """Return the cover's pose for these values."""
        zero = next(iter(values.values())).new_zeros(())
        turns = (
            Rotation.from_rotvec(_vector(names, values, zero))
            for names in (self.tilt, *self.extra_tilts)
            if any(names)
        )
        return CoverPose(_vector(self.origin, values, zero), tuple(turns))

    def pull_leaving(
        self, values: Values, pose: CoverPose, local: Rays, by_rays: ByRay, names: frozenset[str]
    ) -> tuple[ByRay, ByName]:
        """Return the derivatives by rays in the cover's frame and by these parameters, from the (k,
        M) derivatives by the same rays in the camera frame.

        Args:
            pose: that for these values.
            local: the rays in the cover's frame.
        """
        by_local = ByRay(pose.turn(by_rays.origin), pose.turn(by_rays.direction))
        if not names & {param.name for param in self.params}:
            return by_local, {}
        by_turn = _turning(pose, local, by_rays)
        return by_local, self._by_parameters(values, pose, by_rays.origin, by_turn, names)

    def pull_entering(
        self, values: Values, pose: CoverPose, entered: Rays, by_rays: ByRay, names: frozenset[str]
    ) -> tuple[ByRay, ByName]:
        """Return the derivatives by rays in the camera frame and by these parameters, from the (k,
        M) derivatives by the same rays in the cover's frame, `entered`.
        """
        by_outer = ByRay(
            pose.turn(by_rays.origin, back=True), pose.turn(by_rays.direction, back=True)
        )
        if not names & {param.name for param in self.params}:
            return by_outer, {}
        by_turn = _turning(pose, entered, by_outer)
        by = self._by_parameters(values, pose, by_outer.origin, by_turn, names)
        return by_outer, {name: -value for name, value in by.items()}

    def _by_parameters(
        self,
        values: Values,
        pose: CoverPose,
        by_shift: Vector,
        by_turn: Vector,
        names: frozenset[str],
    ) -> ByName:
        """Return the derivatives by these parameters, from those by the translation (per m) and by
        a further small rotation (rad), both along the axes of the camera frame.
        """
        by: ByName = {}
        for name, component in zip(self.origin, (by_shift.x, by_shift.y, by_shift.z), strict=True):
            if name and name in names:
                add_to(by, name, component)
        zero = next(iter(values.values())).new_zeros(())
        used = [turn for turn in (self.tilt, *self.extra_tilts) if any(turn)]
        for place, turn_names in enumerate(used):
            if not names.intersection(name for name in turn_names if name):
                continue
            jacobian = left_jacobian(_vector(turn_names, values, zero).stacked())
            for entry, name in enumerate(turn_names):
                if name and name in names:
                    axis = Vector.of(jacobian[..., entry])
                    for turn in pose.turns[:place][::-1]:
                        axis = turn.turn(axis)
                    add_to(by, name, axis.dot(by_turn))
        return by


def _turning(pose: CoverPose, rays: Rays, by_outside: ByRay) -> Vector:
    """Return the derivatives by a further small rotation of the frame of rays that are fixed in it,
    from those by the same rays in the camera frame.
    """
    arm = pose.turn(rays.origin, back=True)
    direction = pose.turn(rays.direction, back=True)
    return arm.cross(by_outside.origin) + direction.cross(by_outside.direction)


@dataclass(frozen=True, slots=True)
class CoverPose:
    """T_camera_cover as a translation and a product of rotations."""

    shift: Vector
    """m"""
    turns: tuple[Rotation, ...]
    """R is their product, from left to right."""

    def enter(self, point: Vector) -> Vector:
        """Transform points from the camera frame into the cover's frame."""
        return self.turn(point - self.shift)

    def leave(self, point: Vector) -> Vector:
        """Transform points from the cover's frame into the camera frame."""
        return self.turn(point, back=True) + self.shift

    def enter_rays(self, rays: Rays) -> Rays:
        """Transform rays from the camera frame into the cover's frame."""
        return Rays(self.enter(rays.origin), self.turn(rays.direction), rays.failure)

    def leave_rays(self, rays: Rays) -> Rays:
        """Transform rays from the cover's frame into the camera frame."""
        return Rays(self.leave(rays.origin), self.turn(rays.direction, back=True), rays.failure)

    def turn(self, direction: Vector, *, back: bool = False) -> Vector:
        """Turn directions from the camera frame into the cover's frame, or back."""
        for turn in self.turns[:: -1 if back else 1]:
            direction = turn.turn(direction, back=not back)
        return direction


def _vector(names: Names, values: Values, zero: Tensor) -> Vector:
    return Vector(*(values[name] if name else zero for name in names))
