"""The pose of the cover in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from calib.optics.derivatives import ByName, add_to
from calib.optics.params import Param, Values
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

    def by_parameters(self, values: Values, by_shift: Vector, by_turn: Vector) -> ByName:
        """Return the derivatives by the parameters, from those by the translation (per m) and by a
        further small rotation (rad), both along the axes of the camera frame.
        """
        derivatives: ByName = {}
        for name, component in zip(self.origin, (by_shift.x, by_shift.y, by_shift.z), strict=True):
            if name:
                add_to(derivatives, name, component)
        turns = self.at(values).turns
        zero = next(iter(values.values())).new_zeros(())
        used = [names for names in (self.tilt, *self.extra_tilts) if any(names)]
        for place, names in enumerate(used):
            jacobian = left_jacobian(_vector(names, values, zero).stacked())
            for entry, name in enumerate(names):
                if name:
                    axis = Vector.of(jacobian[..., entry])
                    for turn in turns[:place][::-1]:
                        axis = turn.turn(axis)
                    add_to(derivatives, name, axis.dot(by_turn))
        return derivatives


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

    def turn(self, direction: Vector, *, back: bool = False) -> Vector:
        """Turn directions from the camera frame into the cover's frame, or back."""
        for turn in self.turns[:: -1 if back else 1]:
            direction = turn.turn(direction, back=not back)
        return direction


def _vector(names: Names, values: Values, zero: Tensor) -> Vector:
    return Vector(*(values[name] if name else zero for name in names))
