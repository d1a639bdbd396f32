"""The cover is turned about an axis of its own symmetry: its shape stays, its unevenness comes
along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.cover_tilt import axis_names
from calib.effects.effect import Effect, EffectContext, EffectParameter
from calib.optics.cone import Cone
from calib.optics.flat import Flat
from calib.optics.path import Path
from calib.session.tolerances import Tolerance

SPIN = Tolerance(0.05, "rad", 1e-2, "nothing but friction holds a round cover in its mount")


@dataclass(frozen=True, slots=True)
class CoverSpin(Effect):
    """Turned about the axes about which its smooth shape is round.

    Nobody sees it of a cover without relief.
    """

    axes: str
    """y of a cone or cylinder, z of a window, xyz of a dome."""
    name: ClassVar[str] = "cover_spin"
    about: ClassVar[str] = "the cover"
    on_cover: ClassVar[bool] = True
    advice: ClassVar[str] = "hold the board where the cover is most uneven"

    @classmethod
    def propose(cls, there: EffectContext) -> tuple[Self, ...]:
        if not there.path.relief:
            return ()
        match there.path.cover[-1].surface:
            case Cone():
                return (cls("y"),)
            case Flat():
                return (cls("z"),)
        return (cls("xyz"),)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter.of(f"cover_spin.{axis}", SPIN) for axis in self.axes)

    def apply(self, path: Path) -> Path:
        names = axis_names("cover_spin", self.axes)
        turned = (
            replace(i, frame=replace(i.frame, extra_tilts=(*i.frame.extra_tilts, names)))
            for i in path.cover
        )
        return replace(path, cover=tuple(turned))
