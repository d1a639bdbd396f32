"""The cover is turned against the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.cover_frame import Names
from calib.optics.path import Path
from calib.session.parameter_names import COVER
from calib.session.tolerances import COVER_TILT


@dataclass(frozen=True, slots=True)
class CoverTilt(Effect):
    """A rotation about the origin of the cover's frame, in addition to the stated tilt."""

    axes: str
    """The axes about which a rotation changes this shape: xz for a cone or cylinder, xy for a
    window.

    A rotated dome is the same dome.
    """
    name: ClassVar[str] = "cover_tilt"
    description: ClassVar[str] = "The cover is turned against the camera."
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        axes = turning_axes(context.path)
        stated = {COVER.of(f"tilt.{axis}") for axis in axes}
        return (cls(axes),) if axes and not stated & context.estimated else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(
            EffectParameter.of(f"cover_tilt.{axis}", COVER_TILT, (COVER.of(f"tilt.{axis}"),))
            for axis in self.axes
        )

    def apply(self, path: Path) -> Path:
        names = axis_names("cover_tilt", self.axes)
        interfaces = (
            replace(i, frame=replace(i.frame, extra_tilts=(*i.frame.extra_tilts, names)))
            for i in path.cover
        )
        return replace(path, cover=tuple(interfaces))


def turning_axes(path: Path) -> str:
    """Return the axes about which a rotation changes the cover."""
    symmetry = path.cover[-1].surface.symmetry if path.cover else "xyz"
    return "".join(axis for axis in "xyz" if axis not in symmetry)


def axis_names(effect: str, axes: str) -> Names:
    """Return the names of the rotation's values about x, y and z; None for an axis that is not
    among `axes`.
    """
    return (
        f"{effect}.x" if "x" in axes else None,
        f"{effect}.y" if "y" in axes else None,
        f"{effect}.z" if "z" in axes else None,
    )
