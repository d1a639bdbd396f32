"""The cover is turned against the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.cone import Cone
from calib.optics.cover_frame import Names
from calib.optics.flat import Flat
from calib.optics.path import Path
from calib.session.tolerances import COVER_TILT


@dataclass(frozen=True, slots=True)
class CoverTilt(Effect):
    """Turned about the origin of the cover's frame, on top of the tilt that is stated."""

    axes: str
    """Those about which a turn changes this shape: xz of a cone or cylinder, xy of a window.

    A turned dome is the same dome.
    """
    name: ClassVar[str] = "cover_tilt"
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        axes = turning_axes(there.path)
        stated = {f"cover.tilt.{axis}" for axis in axes}
        return (cls(axes),) if axes and not stated & there.estimated else ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(
            Unknown.of(f"cover_tilt.{axis}", COVER_TILT, (f"cover.tilt.{axis}",))
            for axis in self.axes
        )

    def apply(self, path: Path) -> Path:
        names = axis_names("cover_tilt", self.axes)
        turned = (
            replace(i, frame=replace(i.frame, extra_tilts=(*i.frame.extra_tilts, names)))
            for i in path.cover
        )
        return replace(path, cover=tuple(turned))


def turning_axes(path: Path) -> str:
    """The axes about which a turn changes the cover."""
    if not path.cover:
        return ""
    match path.cover[-1].surface:
        case Cone():
            return "xz"
        case Flat():
            return "xy"
    return ""


def axis_names(effect: str, axes: str) -> Names:
    """What the values call a turn about x, y and z."""
    x, y, z = (f"{effect}.{axis}" if axis in axes else None for axis in "xyz")
    return x, y, z
