"""The part that smooth fields share: a displacement over an area, of products of cosines whose
sizes the evidence chooses.

Source: N. Ahmed, T. Natarajan, K. Rao, Discrete cosine transform (1974).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Unknown, linear_evidence
from calib.optics.linear_term import contract
from calib.optics.params import Param, Values

WAVES = 9
"""Cosines along each direction, the constant one among them."""
FIRST_KNEE = 2.0
SIZES = tuple(10.0 ** (step / 3) for step in range(-8, 4))
"""Times the first size."""
KNEES = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, slots=True)
class CosineField(Effect):
    """Products of cosines, as of a discrete cosine transform, for each of the two directions."""

    low: tuple[float, float]
    """m or px, of the area."""
    high: tuple[float, float]
    size: float
    """m or px: standard deviation of the displacement's lowest waves."""
    knee: float
    """The wave from which on they are the smaller the finer they are."""
    area: ClassVar[str]
    """The parameters' name, less their direction."""
    unit: ClassVar[str]
    scale: ClassVar[float]
    first_size: ClassVar[float]

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(
            Unknown(Param(f"{self.area}.{axis}", self.unit, self.scale, (WAVES**2,)), self.size)
            for axis in "xy"
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the size and the knee of the largest evidence: of the residual's probability, the
        field itself integrated out.
        """
        forms = [
            replace(self, size=self.first_size * factor, knee=knee)
            for factor in SIZES
            for knee in KNEES
        ]
        mine = self._falls(torch.float64).numpy().ravel() * self.scale

        def evidence(form: Self) -> float:
            spread = np.tile(
                form.size * form._falls(torch.float64).numpy().ravel() / mine, 2
            )  # of my parameters over their scales
            return linear_evidence(information, score, spread)

        return max(forms, key=evidence)

    def _falls(self, dtype: torch.dtype) -> Tensor:
        """(WAVES, WAVES) how much of each wave there is."""
        order = torch.arange(WAVES, dtype=dtype)
        return 1 / (1 + (order[:, None] ** 2 + order**2) / self.knee**2)

    def shift(self, x: Tensor, y: Tensor, values: Values) -> list[tuple[Tensor, Tensor, Tensor]]:
        """(...) m or px by which a point is moved along x and along y, each with its slopes by x
        and by y, which carry no derivatives.
        """
        with torch.no_grad():
            (along, rise_along), (down, rise_down) = self._cosines(x, y)
        falls = self._falls(x.dtype).to(x.device).flatten()
        found = []
        for name, probe in self.probes.items():
            sizes = values[name] * falls
            table = sizes.reshape(*sizes.shape[:-1], WAVES, WAVES)
            through = contract(along, table)
            size = (through * down).sum(0)
            with torch.no_grad():
                by_x, by_y = (
                    (contract(rise_along, table) * down).sum(0),
                    (through * rise_down).sum(0),
                )
            found.append((size + values[probe] if probe in values else size, by_x, by_y))
        return found

    @property
    def probes(self) -> dict[str, str]:
        return {param.name: f"{param.name}.probe" for param in self.params}

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """As `linear_term` has them."""
        (along, _), (down, _) = self._cosines(x, y)
        waves = (along.unsqueeze(1) * down).flatten(0, 1).movedim(0, -1) * self._falls(
            x.dtype
        ).flatten()
        return dict.fromkeys(self.probes, waves)

    def _cosines(self, x: Tensor, y: Tensor) -> list[tuple[Tensor, Tensor]]:
        """(WAVES, ...) cosines along each direction, and their derivatives."""
        order = (
            torch.arange(WAVES, dtype=x.dtype, device=x.device).reshape(-1, *[1] * x.ndim)
            * torch.pi
        )
        found = []
        for at, low, high in zip((x, y), self.low, self.high, strict=True):
            angle = (at - low) / (high - low) * order
            found.append((torch.cos(angle), torch.sin(angle) * (-order / (high - low))))
        return found
