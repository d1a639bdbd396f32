"""The entrance pupil moves along the optical axis with the angle of incidence, as that of a wide
lens does: the camera has no single centre. If the lens's elements are not centred, the pupil moves
to one side as well.

Source: D. B. Gennery, Generalized camera calibration including fish-eye lenses (2006), section 2.3:
the shift is even in the angle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import Effect, EffectContext, EffectParameter, select_form
from calib.optics.lens import PUPIL, PUPIL_LATERAL
from calib.optics.path import Path
from calib.session.tolerances import ENTRANCE_PUPIL, ENTRANCE_PUPIL_ASIDE


@dataclass(frozen=True, slots=True)
class EntrancePupil(Effect):
    """The start of a ray at an angle a to the axis: z = e2 a^2 + e4 a^4 on the axis and, if the
    lens is decentred, (x2, y2) a^2 off it.
    """

    decentred: bool = False
    name: ClassVar[str] = "entrance_pupil"
    description: ClassVar[str] = (
        "The entrance pupil moves along the optical axis with the angle of incidence."
    )
    is_sum: ClassVar[bool] = True
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "hold the board as near as the lens is sharp and far away, in the picture's corners too"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if context.path.lens.pupil else (cls(decentred=True),)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        axial = tuple(EffectParameter(param, ENTRANCE_PUPIL.sigma) for param in PUPIL)
        if not self.decentred:
            return axial
        lateral = (EffectParameter(param, ENTRANCE_PUPIL_ASIDE.sigma) for param in PUPIL_LATERAL)
        return (*axial, *lateral)

    def alternatives(self) -> tuple[Self, ...]:
        return replace(self, decentred=False), replace(self, decentred=True)

    def tune(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """Return the form with the larger evidence, to first order."""
        return select_form(
            [form for form in self.alternatives() if form.decentred <= self.decentred],
            information,
            score,
        )

    def apply(self, path: Path) -> Path:
        return replace(
            path,
            lens=path.lens.with_pupil(
                tuple(parameter.param for parameter in self.effect_parameters)
            ),
        )
