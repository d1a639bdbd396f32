"""The change that the cover has turned about an axis of symmetry: only its relief moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.cover_tilt import axis_names, turn_cover
from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.path import Path
from calib.session.tolerances import Tolerance

SPIN = Tolerance(0.05, "rad", 1e-2, "nothing but friction holds a round cover in its mount")


@dataclass(frozen=True, slots=True)
class CoverSpin(Effect):
    """A rotation about the axes of symmetry of the cover.

    It has no effect on a cover without relief.
    """

    axes: str
    """The axes: y for a cone or cylinder, z for a window, xyz for a dome."""
    name: ClassVar[str] = "cover_spin"
    description: ClassVar[str] = "The cover is turned about its own axis."
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = "hold the board where the cover is most uneven"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        if not context.path.relief:
            return ()
        axes = context.path.cover[-1].surface.symmetry
        return (cls(axes),) if axes else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter.of(f"cover_spin.{axis}", SPIN) for axis in self.axes)

    def apply(self, path: Path) -> Path:
        return turn_cover(path, axis_names(self.name, self.axes))
