"""Polynomials over a board: products of Legendre's, P_i(u) P_j(v), where u and v are 1 at the
outermost corners.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from numpy.polynomial.legendre import leg2poly
from numpy.typing import NDArray
from torch import Tensor

RIM = 1.25
"""Of the half: no corner is farther out, where polynomials run away."""

Term = tuple[int, int]
"""Degrees in u and in v."""


def terms_of(degrees: Iterable[int]) -> tuple[Term, ...]:
    """All of some degrees, each from x alone to y alone."""
    return tuple((degree - j, j) for degree in degrees for j in range(degree + 1))


def called(term: Term) -> str:
    """xxy of (2, 1)."""
    return "x" * term[0] + "y" * term[1]


def powers(at: Tensor, half: float, degree: int) -> tuple[Tensor, Tensor]:
    """(degree + 1, ...) of a coordinate over its half, kept within the rim, and (...) 1 inside of
    it, else 0.
    """
    along = at / half
    within = along.clamp(-RIM, RIM)
    return torch.stack(
        [torch.ones_like(within), *within.expand(degree, *within.shape).cumprod(0)]
    ), (along.abs() < RIM).to(at.dtype)


def monomials(terms: Iterable[Term]) -> NDArray[np.float64]:
    """(n, orders, orders) of each term by the products u^a v^b."""
    listed = tuple(terms)
    orders = 1 + max(max(term) for term in listed)
    table = np.zeros((len(listed), orders, orders))
    for row, (i, j) in zip(table, listed, strict=True):
        row[: i + 1, : j + 1] = np.outer(leg2poly([0] * i + [1]), leg2poly([0] * j + [1]))
    return table
