"""The base class of effects with parameters of every view's own."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

from calib.effects.effect import BLOCK_SCALES, EACH_VIEW, Effect, EffectParameter
from calib.optics.path import Path


@dataclass(frozen=True, slots=True)
class ViewEffect(Effect):
    """An effect that adds the block `per_view` to every view. Views share no parameter of it."""

    size: float = field(default=BLOCK_SCALES[-1], kw_only=True)
    """The prior standard deviation of each parameter, over its largest plausible size."""
    about: ClassVar[str] = "each single view"
    varies: ClassVar[str] = EACH_VIEW

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return ()

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, size=size) for size in BLOCK_SCALES)

    def with_prior(self, path: Path) -> Path:
        """Return the path with the size of the block's prior."""
        return replace(path, block_scales=(*path.block_scales, (self.per_view, self.size)))
