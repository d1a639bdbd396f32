"""The entrance pupil moves along the optical axis with the angle of incidence, as that of a wide lens does: no one point is the camera's.

Source: D. B. Gennery, Generalized camera calibration including fish-eye lenses (2006), section 2.3, where the shift is even in the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.lens import PUPIL
from calib.optics.path import Path
from calib.session.tolerances import ENTRANCE_PUPIL


@dataclass(frozen=True, slots=True)
class EntrancePupil(Effect):
    """A ray at an angle a to the axis starts at z = e2 a^2 + e4 a^4 on it."""

    name: ClassVar[str] = "entrance_pupil"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "hold the board as near as the lens is sharp and far away, in the picture's corners too"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.lens.pupil else (cls(),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(Unknown(param, ENTRANCE_PUPIL.sigma) for param in PUPIL)

    def apply(self, path: Path) -> Path:
        return replace(path, lens=path.lens.with_pupil())
