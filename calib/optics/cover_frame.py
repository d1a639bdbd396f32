"""Where the cover stands in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.rotation import Rotation
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
    more: tuple[Names, ...] = ()
    """Further turns on top of that, rad."""

    @property
    def params(self) -> tuple[Param, ...]:
        turns = (n for names in (self.tilt, *self.more) for n in names if n)
        return (
            *(Param(n, "m", 1e-3) for n in self.origin if n),
            *(Param(n, "rad", 1e-2) for n in turns),
        )

    def at(self, values: Values) -> Standing:
        """Where these values put it."""
        zero = next(iter(values.values())).new_zeros(())
        turns = (
            Rotation.by(_named(names, values, zero))
            for names in (self.tilt, *self.more)
            if any(names)
        )
        return Standing(_named(self.origin, values, zero), tuple(turns))


@dataclass(frozen=True, slots=True)
class Standing:
    """A cover's frame in the camera frame."""

    shift: Vector
    """m"""
    turns: tuple[Rotation, ...]
    """The first turns the cover about its own origin, each of the others on top of that."""

    def enter(self, point: Vector) -> Vector:
        """Points of the camera frame in the cover's frame."""
        return self.turn(point - self.shift)

    def leave(self, point: Vector) -> Vector:
        """Points of the cover's frame in the camera frame."""
        return self.turn(point, back=True) + self.shift

    def turn(self, direction: Vector, *, back: bool = False) -> Vector:
        """Directions of the camera frame in the cover's frame, or back."""
        for turn in self.turns[:: -1 if back else 1]:
            direction = turn.turn(direction, back=not back)
        return direction


def _named(names: Names, values: Values, zero: Tensor) -> Vector:
    return Vector(*(values[name] if name else zero for name in names))
