"""The board is not flat: a smooth deflection, of a degree that the evidence chooses.

Sources: mrcal's `calobject_warp` for the two terms of a dish
(https://mrcal.secretsauce.net/formulation.html); S. Timoshenko, S. Woinowsky-Krieger, Theory of
plates and shells (1959), section 10: a plate's bending energy is proportional to the square of its
curvature.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter, select_form
from calib.optics.board_polynomials import (
    Term,
    bend_monomials,
    bend_sigma,
    bend_weights,
    powers,
    term_name,
    terms_of_degrees,
)
from calib.optics.linear_term import contract, with_slopes
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_SHAPE

DEGREES = (2, 3, 4)
PROBE = "board_shape.probe"


@dataclass(frozen=True, slots=True)
class BoardShape(Effect):
    """A deflection that is a sum of terms, by degree.

    Degree 2 is xx (1 - u^2) + xy u v + yy (1 - v^2): xx and yy are the distances of the middle
    behind the edges, xy that of two opposite corners behind the other two. Degrees 3 and 4 are
    Legendre's P_i(u) P_j(v), i + j = 3, 4; a term's name is i times x, then j times y. Degrees 0
    and 1 are left out, because a pose has the same effect. Beyond the rim the board continues
    level.
    """

    half_x: float
    """m, half the distance between the outermost corners along x, where u = 1."""
    half_y: float
    degree: int = DEGREES[0]
    name: ClassVar[str] = "board_shape"
    description: ClassVar[str] = "The board is not flat: it deviates smoothly from a plane."
    legend: ClassVar[Mapping[str, str]] = {
        "xx": "the middle lies this far behind the left and right edges.",
        "xy": "two opposite corners lie this far behind the other two.",
        "yy": "the middle lies this far behind the upper and lower edges.",
        "": "finer bends of the board.",
    }
    is_sum: ClassVar[bool] = True
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = (
        "tilt the board by 40 degrees and more, in both directions, so that its middle and its"
        " edges lie at different depths"
    )

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return (cls(*context.board.half, DEGREES[-1]),) if context.board.is_flat else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(_parameter(term) for term in self._terms)

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    @property
    def _terms(self) -> tuple[Term, ...]:
        return terms_of_degrees(degree for degree in DEGREES if degree <= self.degree)

    def alternatives(self) -> tuple[Self, ...]:
        return tuple(replace(self, degree=degree) for degree in DEGREES)

    def tune(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """Return the form with the degree of the largest evidence, to first order."""
        return select_form(
            [form for form in self.alternatives() if form.degree <= self.degree], information, score
        )

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, bends=(*path.target.bends, self)))

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height, positive away from the camera, and its slopes, which carry no
        derivatives.
        """
        with torch.no_grad():
            (u, v), (inside_u, inside_v) = self._powers(x, y)
        sizes = torch.stack([values[name] for name in self.probes], -1)
        table = (sizes @ bend_monomials(self._terms).to(sizes)).reshape(
            *sizes.shape[:-1], self.degree + 1, self.degree + 1
        )
        by_power = contract(u, table)
        height = (by_power * v).sum(0)
        with torch.no_grad():
            order = torch.arange(1, self.degree + 1).to(u).reshape(-1, *[1] * x.ndim)
            by_u = (contract(u[:-1] * order, table[..., 1:, :]) * v).sum(0)
            by_x = by_u * inside_u / self.half_x
            by_y = (by_power[1:] * v[:-1] * order).sum(0) * inside_v / self.half_y
        return with_slopes(height, x, y, by_x, by_y), by_x, by_y

    @property
    def probes(self) -> dict[str, str]:
        return {parameter.param.name: PROBE for parameter in self.effect_parameters}

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """Return the weights of `LinearTerm`."""
        (u, v), _ = self._powers(x, y)
        weights = bend_weights(self._terms, u, v)
        return dict(zip(self.probes, torch.split(weights, 1, -1), strict=True))

    def _powers(self, x: Tensor, y: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        """Return the (degree + 1, ...) powers of u and of v, and (...) 1 within the rim, else 0,
        for both.
        """
        u, inside_u = powers(x, self.half_x, self.degree)
        v, inside_v = powers(y, self.half_y, self.degree)
        return (u, v), (inside_u, inside_v)


@cache
def _parameter(term: Term) -> EffectParameter:
    parameter = EffectParameter.of(f"board_shape.{term_name(term)}", BOARD_SHAPE)
    return replace(parameter, sigma=bend_sigma(BOARD_SHAPE.sigma, term))
