"""Where the cover stands in the camera frame."""

from dataclasses import dataclass

import torch

from calib.optics import rotation
from calib.optics.params import Param, Values
from calib.optics.vector import Vector

Names = tuple[str | None, str | None, str | None]


@dataclass(frozen=True, slots=True)
class CoverFrame:
    """T_camera_cover from named values: x_camera = R x_cover + t. A name that is None stands for zero."""

    origin: Names = (None, None, None)
    """t, m: the cover's origin in the camera frame."""
    tilt: Names = (None, None, None)
    """R's rotation vector, rad: the cover is turned about its own origin."""
    more: tuple[Names, ...] = ()
    """Further turns on top of that, rad."""

    @property
    def params(self) -> tuple[Param, ...]:
        turns = (n for names in (self.tilt, *self.more) for n in names if n)
        return (*(Param(n, "m", 1e-3) for n in self.origin if n), *(Param(n, "rad", 1e-2) for n in turns))

    def enter(self, point: Vector, values: Values) -> Vector:
        """Points of the camera frame in the cover's frame."""
        return self.turn(point - self._shift(values, point), values)

    def leave(self, point: Vector, values: Values) -> Vector:
        """Points of the cover's frame in the camera frame."""
        return self.turn(point, values, back=True) + self._shift(values, point)

    def turn(self, direction: Vector, values: Values, *, back: bool = False) -> Vector:
        """Directions of the camera frame in the cover's frame, or back."""
        for names in (self.tilt, *self.more)[:: -1 if back else 1]:
            if any(names):
                rotvec = _named(names, values, direction)
                direction = direction.turned(rotation.matrix(rotvec.stacked()), back=not back)
        return direction

    def _shift(self, values: Values, like: Vector) -> Vector:
        return _named(self.origin, values, like)


def _named(names: Names, values: Values, like: Vector) -> Vector:
    zero = torch.zeros((), dtype=like.z.dtype, device=like.z.device)
    return Vector(*(values[name] if name else zero for name in names))
