"""The base class of smooth fields: a displacement over an area, as a sum of products of cosines.
The evidence chooses the sizes of these.

Source: N. Ahmed, T. Natarajan, K. Rao, Discrete cosine transform (1974).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, EffectParameter, log_bayes_factor
from calib.optics.linear_term import contract
from calib.optics.params import Param, Values

WAVES = 9
"""The number of cosines along each direction, including the constant."""
FIRST_KNEE = 2.0
SIZE_FACTORS = tuple(10.0 ** (step / 3) for step in range(-8, 4))
"""Factors of the first size that `tune` tries."""
KNEES = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, slots=True)
class CosineField(Effect):
    """A displacement along x and along y, each a sum of the products of cosines of a discrete
    cosine transform.
    """

    low: tuple[float, float]
    """m or px: the smallest coordinates of the area."""
    high: tuple[float, float]
    """m or px: the largest coordinates of the area."""
    size: float
    """m or px: the prior standard deviation of the lowest waves."""
    knee: float
    """The order of the wave above which the prior standard deviations fall."""
    area: ClassVar[str]
    """The name of the parameters without their direction."""
    unit: ClassVar[str]
    scale: ClassVar[float]
    first_size: ClassVar[float]

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(
            EffectParameter(
                Param(f"{self.area}.{axis}", self.unit, self.scale, (WAVES**2,)), self.size
            )
            for axis in "xy"
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    def tune(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """Return the field with the size and the knee of the largest evidence: the residual's
        probability, with the field integrated out.
        """
        forms = [
            replace(self, size=self.first_size * factor, knee=knee)
            for factor in SIZE_FACTORS
            for knee in KNEES
        ]
        scales = self._falls(torch.float64).numpy().ravel() * self.scale

        def evidence(form: Self) -> float:
            falls = form._falls(torch.float64).numpy().ravel()
            # Over the scales of this field's parameters.
            spread = np.tile(form.size * falls / scales, 2)
            return log_bayes_factor(information, score, spread)

        return max(forms, key=evidence)

    def _falls(self, dtype: torch.dtype) -> Tensor:
        """Return the (WAVES, WAVES) prior standard deviation of each wave over that of the
        lowest.
        """
        order = torch.arange(WAVES, dtype=dtype)
        return 1 / (1 + (order[:, None] ** 2 + order**2) / self.knee**2)

    def shift(self, x: Tensor, y: Tensor, values: Values) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Return the (...) m or px shift of points along x and along y, each with its slopes by x
        and by y, which carry no derivatives.
        """
        with torch.no_grad():
            (cosines_x, rise_x), (cosines_y, rise_y) = self._cosines(x, y)
        falls = self._falls(x.dtype).to(x.device).flatten()
        shifts = []
        for name, probe in self.probes.items():
            sizes = values[name] * falls
            table = sizes.reshape(*sizes.shape[:-1], WAVES, WAVES)
            by_wave = contract(cosines_x, table)
            shift = (by_wave * cosines_y).sum(0)
            with torch.no_grad():
                by_x = (contract(rise_x, table) * cosines_y).sum(0)
                by_y = (by_wave * rise_y).sum(0)
            shifts.append((shift + values[probe] if probe in values else shift, by_x, by_y))
        return shifts

    @property
    def probes(self) -> dict[str, str]:
        return {param.name: f"{param.name}.probe" for param in self.params}

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """Return the weights of `LinearTerm`."""
        (cosines_x, _), (cosines_y, _) = self._cosines(x, y)
        products = (cosines_x.unsqueeze(1) * cosines_y).flatten(0, 1).movedim(0, -1)
        waves = products * self._falls(x.dtype).flatten()
        return dict.fromkeys(self.probes, waves)

    def _cosines(self, x: Tensor, y: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return the (WAVES, ...) cosines along each direction, and their derivatives."""
        order = (
            torch.arange(WAVES, dtype=x.dtype, device=x.device).reshape(-1, *[1] * x.ndim)
            * torch.pi
        )
        cosines = []
        for coordinate, low, high in zip((x, y), self.low, self.high, strict=True):
            angle = (coordinate - low) / (high - low) * order
            cosines.append((torch.cos(angle), torch.sin(angle) * (-order / (high - low))))
        return cosines
