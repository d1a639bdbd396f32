"""The board is not flat: a smooth deflection, of a degree that the evidence chooses.

Sources: mrcal's `calobject_warp` for the two terms of a dish (https://mrcal.secretsauce.net/formulation.html); S. Timoshenko,
S. Woinowsky-Krieger, Theory of plates and shells (1959), section 10: a plate's bending energy goes with the square of its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown, most_evident
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_SHAPE

DEGREES = (2, 3, 4)
RIM = 1.25
"""Of the half: no corner is farther out, where polynomials run away, and the board goes on level."""


@dataclass(frozen=True, slots=True)
class BoardShape(Effect):
    """The sum of its terms, by degree: xx (1 - u^2) + xy u v + yy (1 - v^2), by how much the middle is farther from the camera than the
    edges, and by how much two corners are than the others; then Legendre's P_i(u) P_j(v), i + j = 3, 4, called by i times x, j times y.
    What a pose does as well, degrees 0 and 1, is left out."""

    half_x: float
    """m, half the distance between the outermost corners along x: there u = 1."""
    half_y: float
    degree: int = DEGREES[0]
    name: ClassVar[str] = "board_shape"
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = (
        "tilt the board by 40 degrees and more, in both directions, so that its middle and its edges lie at different depths"
    )

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return (cls(*there.board.half, DEGREES[-1]),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(_unknown(i, j) for i, j in self._terms)

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    @property
    def _terms(self) -> tuple[tuple[int, int], ...]:
        return tuple((degree - j, j) for degree in DEGREES if degree <= self.degree for j in range(degree + 1))

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, degree=degree) for degree in DEGREES)

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the degree of the largest evidence, to first order."""
        return most_evident([form for form in self.alternatives() if form.degree <= self.degree], information, score)

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, bends=(*path.target.bends, self)))

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """(...) m away from the camera, and its slopes."""
        u, v = _legendre(x / self.half_x), _legendre(y / self.half_y)
        up, by_x, by_y = (torch.zeros_like(x) for _ in range(3))
        for (i, j), unknown in zip(self._terms, self.unknowns, strict=True):
            size = values[unknown.param.name]
            if (i == 2 and j == 0) or (i == 0 and j == 2):  # 1 - u^2 is two thirds of 1 - P_2
                size = -2 / 3 * size
                up = up - size
            up = up + size * u[0][i] * v[0][j]
            by_x = by_x + size * u[1][i] * v[0][j] / self.half_x
            by_y = by_y + size * u[0][i] * v[1][j] / self.half_y
        return up, by_x, by_y


def _unknown(i: int, j: int) -> Unknown:
    whole = Unknown.of(f"board_shape.{'x' * i}{'y' * j}", BOARD_SHAPE)
    return replace(whole, sigma=BOARD_SHAPE.sigma * (DEGREES[0] / (i + j)) ** 2)


def _legendre(u: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """(...) P_0 to P_4 and their derivatives, within the rim."""
    inside = (u.abs() < RIM).to(u.dtype)
    u = u.clamp(-RIM, RIM)
    square = u * u
    values = [torch.ones_like(u), u, (3 * square - 1) / 2, u * (5 * square - 3) / 2, (square * (35 * square - 30) + 3) / 8]
    slopes = [torch.zeros_like(u), torch.ones_like(u), 3 * u, (15 * square - 3) / 2, u * (35 * square - 15) / 2]
    return values, [inside * slope for slope in slopes]
