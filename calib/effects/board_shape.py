"""The board is not flat: a smooth deflection, of a degree that the evidence chooses.

Sources: mrcal's `calobject_warp` for the two terms of a dish (https://mrcal.secretsauce.net/formulation.html); S. Timoshenko,
S. Woinowsky-Krieger, Theory of plates and shells (1959), section 10: a plate's bending energy goes with the square of its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown, most_evident
from calib.optics.linear_part import sloped, times
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_SHAPE

DEGREES = (2, 3, 4)
PROBE = "board_shape.probe"
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
        """(...) m away from the camera, and its slopes, which carry no derivatives."""
        with torch.no_grad():
            (u, v), (rise_u, rise_v) = self._polynomials(x, y)
        sizes = torch.stack([values[unknown.param.name] for unknown in self.unknowns], -1)
        table = (sizes @ _products(self._terms).to(sizes)).reshape(*sizes.shape[:-1], self.degree + 1, self.degree + 1)
        along = times(u, table)
        up = (along * v).sum(-1)
        with torch.no_grad():
            by_x, by_y = (times(rise_u, table) * v).sum(-1) / self.half_x, (along * rise_v).sum(-1) / self.half_y
        if PROBE in values:
            up = up + values[PROBE]
        return sloped(up, x, y, by_x, by_y), by_x, by_y

    @property
    def probes(self) -> dict[str, str]:
        return {unknown.param.name: PROBE for unknown in self.unknowns}

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """As `linear_part` has them."""
        (u, v), _ = self._polynomials(x, y)
        each = (u.unsqueeze(-1) * v.unsqueeze(-2)).flatten(-2) @ _products(self._terms).to(u).mT
        return dict(zip(self.probes, torch.split(each, 1, -1), strict=True))

    def _polynomials(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """(2, ..., degree + 1) Legendre's P_0 and on, of both coordinates over their halves, and their derivatives; within the rim."""
        u = torch.stack([x / self.half_x, y / self.half_y])
        inside = (u.abs() < RIM).to(u.dtype)
        u = u.clamp(-RIM, RIM)
        values, slopes = [torch.ones_like(u), u], [torch.zeros_like(u), inside]
        for n in range(2, self.degree + 1):
            values.append(((2 * n - 1) * u * values[-1] - (n - 1) * values[-2]) / n)
            slopes.append(slopes[-2] + (2 * n - 1) * inside * values[n - 1])
        return torch.stack(values, -1), torch.stack(slopes, -1)


def _unknown(i: int, j: int) -> Unknown:
    whole = Unknown.of(f"board_shape.{'x' * i}{'y' * j}", BOARD_SHAPE)
    return replace(whole, sigma=BOARD_SHAPE.sigma * (DEGREES[0] / (i + j)) ** 2)


@cache
def _products(terms: tuple[tuple[int, int], ...]) -> Tensor:
    """(n, orders^2) of each term by the products P_i(u) P_j(v)."""
    orders = 1 + max(max(term) for term in terms)
    table = torch.zeros(len(terms), orders, orders, dtype=torch.float64)
    for row, (i, j) in zip(table, terms, strict=True):
        row[i, j] = 1.0
        if (i, j) in ((2, 0), (0, 2)):  # 1 - u^2 is two thirds of 1 - P_2
            row[0, 0], row[i, j] = 2 / 3, -2 / 3
    return table.flatten(1)
