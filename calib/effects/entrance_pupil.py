"""The entrance pupil moves along the optical axis with the angle of incidence, as that of a wide
lens does: no one point is the camera's. Where the lens's elements are not centred, it moves to one
side as well.

Source: D. B. Gennery, Generalized camera calibration including fish-eye lenses (2006), section 2.3,
    where the shift is even in the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import Effect, Surroundings, Unknown, most_evident
from calib.optics.lens import PUPIL, PUPIL_LATERAL
from calib.optics.path import Path
from calib.session.tolerances import ENTRANCE_PUPIL, ENTRANCE_PUPIL_ASIDE


@dataclass(frozen=True, slots=True)
class EntrancePupil(Effect):
    """A ray at an angle a to the axis starts at z = e2 a^2 + e4 a^4 on it; of a lens that is
    decentred, at (x2, y2) a^2 beside it.
    """

    decentred: bool = False
    name: ClassVar[str] = "entrance_pupil"
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "hold the board as near as the lens is sharp and far away, in the picture's corners too"
    )

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return () if there.path.lens.pupil else (cls(decentred=True),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        along = tuple(Unknown(param, ENTRANCE_PUPIL.sigma) for param in PUPIL)
        return (
            (*along, *(Unknown(param, ENTRANCE_PUPIL_ASIDE.sigma) for param in PUPIL_LATERAL))
            if self.decentred
            else along
        )

    def alternatives(self) -> tuple[Self, ...]:
        return replace(self, decentred=False), replace(self, decentred=True)

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the larger evidence, to first order."""
        return most_evident(
            [form for form in self.alternatives() if form.decentred <= self.decentred],
            information,
            score,
        )

    def apply(self, path: Path) -> Path:
        return replace(
            path, lens=path.lens.with_pupil(tuple(unknown.param for unknown in self.unknowns))
        )
