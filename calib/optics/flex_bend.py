"""The bend that each view's board has for itself."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.board_polynomials import bend_monomials, bend_weights, powers, terms_of_degrees
from calib.optics.params import Param, Values

DEGREE = 4
FLEX_TERMS = terms_of_degrees(range(2, DEGREE + 1))
"""The terms of the bend of one view."""


@dataclass(frozen=True, slots=True, eq=False)
class FlexBend:
    """A bend that each view's board has for itself, in the terms of `board_shape`."""

    half: tuple[float, float]
    """m: half the board's width and height; u = x / half[0], v = y / half[1]."""
    sizes: Tensor
    """(..., FLEX_TERMS) m, of each ray's board."""

    @property
    def params(self) -> tuple[Param, ...]:
        return ()

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        del values
        u, inside_u = powers(x, self.half[0], DEGREE)
        v, inside_v = powers(y, self.half[1], DEGREE)
        table = (self.sizes @ bend_monomials(FLEX_TERMS).to(self.sizes)).movedim(-1, 0)
        table = table.reshape(DEGREE + 1, DEGREE + 1, *table.shape[1:])
        order = torch.arange(1, DEGREE + 1).to(u).reshape(-1, *[1] * x.ndim)
        by_power = (table * u.unsqueeze(1)).sum(0)
        by_u = ((table[1:] * (u[:-1] * order).unsqueeze(1)).sum(0) * v).sum(0)
        by_v = (by_power[1:] * v[:-1] * order).sum(0)
        return (
            (by_power * v).sum(0),
            by_u * inside_u / self.half[0],
            by_v * inside_v / self.half[1],
        )

    def weights(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the (..., FLEX_TERMS) derivatives of the height by the sizes."""
        u, _ = powers(x, self.half[0], DEGREE)
        v, _ = powers(y, self.half[1], DEGREE)
        return bend_weights(FLEX_TERMS, u, v)
