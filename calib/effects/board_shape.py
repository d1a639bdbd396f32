"""The board is not flat: a smooth deflection, of a degree that the evidence chooses.

Sources: mrcal's `calobject_warp` for the two terms of a dish
    (https://mrcal.secretsauce.net/formulation.html); S. Timoshenko,
S. Woinowsky-Krieger, Theory of plates and shells (1959), section 10: a plate's bending energy goes
with the square of its curvature.
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
from calib.effects.over_board import Term, called, monomials, powers, terms_of
from calib.optics.linear_term import contract, with_slopes
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_SHAPE

DEGREES = (2, 3, 4)
PROBE = "board_shape.probe"


@dataclass(frozen=True, slots=True)
class BoardShape(Effect):
    """The sum of its terms, by degree: xx (1 - u^2) + xy u v + yy (1 - v^2), by how much the middle
    is farther from the camera than the edges, and by how much two corners are than the others; then
    Legendre's P_i(u) P_j(v), i + j = 3, 4, called by i times x, j times y. What a pose does as
    well, degrees 0 and 1, is left out. Beyond the rim the board goes on level.
    """

    half_x: float
    """m, half the distance between the outermost corners along x: there u = 1."""
    half_y: float
    degree: int = DEGREES[0]
    name: ClassVar[str] = "board_shape"
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = (
        "tilt the board by 40 degrees and more, in both directions, so that its middle and its"
        " edges lie at different depths"
    )

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return (cls(*there.board.half, DEGREES[-1]),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return tuple(_unknown(term) for term in self._terms)

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    @property
    def _terms(self) -> tuple[Term, ...]:
        return terms_of(degree for degree in DEGREES if degree <= self.degree)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, degree=degree) for degree in DEGREES)

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the degree of the largest evidence, to first order."""
        return most_evident(
            [form for form in self.alternatives() if form.degree <= self.degree], information, score
        )

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, bends=(*path.target.bends, self)))

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """(...) m away from the camera, and its slopes, which carry no derivatives."""
        with torch.no_grad():
            (u, v), (inside_u, inside_v) = self._powers(x, y)
        sizes = torch.stack([values[name] for name in self.probes], -1)
        table = (sizes @ _monomials(self._terms).to(sizes)).reshape(
            *sizes.shape[:-1], self.degree + 1, self.degree + 1
        )
        along = contract(u, table)
        up = (along * v).sum(0)
        with torch.no_grad():
            rises = torch.arange(1, self.degree + 1).to(u).reshape(-1, *[1] * x.ndim)
            by_x = (contract(u[:-1] * rises, table[..., 1:, :]) * v).sum(0) * inside_u / self.half_x
            by_y = (along[1:] * v[:-1] * rises).sum(0) * inside_v / self.half_y
        if PROBE in values:
            up = up + values[PROBE]
        return with_slopes(up, x, y, by_x, by_y), by_x, by_y

    @property
    def probes(self) -> dict[str, str]:
        return {unknown.param.name: PROBE for unknown in self.unknowns}

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """As `linear_term` has them."""
        (u, v), _ = self._powers(x, y)
        each = (u.unsqueeze(1) * v).flatten(0, 1).movedim(0, -1) @ _monomials(self._terms).to(u).mT
        return dict(zip(self.probes, torch.split(each, 1, -1), strict=True))

    def _powers(self, x: Tensor, y: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        """(degree + 1, ...) of either coordinate over its half, and (...) whether it is within the
        rim.
        """
        (u, inside_u), (v, inside_v) = (
            powers(x, self.half_x, self.degree),
            powers(y, self.half_y, self.degree),
        )
        return (u, v), (inside_u, inside_v)


@cache
def _unknown(term: Term) -> Unknown:
    whole = Unknown.of(f"board_shape.{called(term)}", BOARD_SHAPE)
    return replace(whole, sigma=BOARD_SHAPE.sigma * (DEGREES[0] / sum(term)) ** 2)


@cache
def _monomials(terms: tuple[Term, ...]) -> Tensor:
    """(n, orders^2) of each term by the products u^a v^b: a dish is 0 at the edges, and not on
    average.
    """
    table = monomials(terms)
    for row, term in zip(table, terms, strict=True):
        if term in ((2, 0), (0, 2)):
            row[:] = 0.0
            row[0, 0], row[term] = 1.0, -1.0
    return torch.from_numpy(table).flatten(1)
