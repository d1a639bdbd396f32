"""The cover is turned against the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.cover_frame import Names
from calib.optics.path import Path
from calib.session.parameter_names import COVER, CoverNames
from calib.session.tolerances import COVER_TILT


@dataclass(frozen=True, slots=True)
class CoverTilt(Effect):
    """A rotation about the origin of the cover's frame, in addition to the stated tilt. Of several
    covers, the outermost one turns.
    """

    axes: str
    """The axes about which a rotation changes this shape: xz for a cone or cylinder, xy for a
    window.

    A rotated dome is the same dome.
    """
    cover: str = COVER.part
    """The name of the cover that turns, the outermost one."""
    name: ClassVar[str] = "cover_tilt"
    description: ClassVar[str] = "The cover is turned against the camera."
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        axes = turning_axes(context.path)
        if not axes:
            return ()
        effect = cls(axes, context.path.cover[-1].surface.names.part)
        return () if {*effect.stated} & context.estimated else (effect,)

    @property
    def stated(self) -> tuple[str, ...]:
        """The names of the stated tilts."""
        return tuple(CoverNames(self.cover).of(f"tilt.{axis}") for axis in self.axes)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(
            EffectParameter.of(f"cover_tilt.{axis}", COVER_TILT, (name,))
            for axis, name in zip(self.axes, self.stated, strict=True)
        )

    def apply(self, path: Path) -> Path:
        return turn_cover(path, axis_names(self.name, self.axes))


def turn_cover(path: Path, names: Names) -> Path:
    """Return the path with a further tilt of the outermost cover about its own origin, whose values
    have these names.
    """
    outermost = path.outermost
    turned = (
        replace(stage, frame=replace(stage.frame, extra_tilts=(*stage.frame.extra_tilts, names)))
        for stage in outermost
    )
    return replace(path, cover=(*path.cover[: -len(outermost)], *turned))


def turning_axes(path: Path) -> str:
    """Return the axes about which a rotation changes the outermost cover."""
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
