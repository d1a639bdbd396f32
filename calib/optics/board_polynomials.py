"""Polynomials over a board: products of Legendre polynomials, P_i(u) P_j(v), where u and v are 1 at
the outermost corners.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
import torch
from numpy.polynomial.legendre import leg2poly
from numpy.typing import NDArray
from torch import Tensor

RIM = 1.25
"""The largest u and v at which the polynomials are evaluated. No corner is farther out, where they
grow without bound.
"""

Term = tuple[int, int]
"""The degrees of a term in u and in v."""


def terms_of_degrees(degrees: Iterable[int]) -> tuple[Term, ...]:
    """Return all terms of these total degrees; each degree runs from x alone to y alone."""
    return tuple((degree - j, j) for degree in degrees for j in range(degree + 1))


def term_name(term: Term) -> str:
    """Return the name of a term: xxy for (2, 1)."""
    return "x" * term[0] + "y" * term[1]


def powers(coordinate: Tensor, half: float, degree: int) -> tuple[Tensor, Tensor]:
    """Return the (degree + 1, ...) powers of a coordinate over its half, clamped to the rim, and
    (...) 1 within the rim, else 0.
    """
    scaled = coordinate / half
    clamped = scaled.clamp(-RIM, RIM)
    table = torch.stack(
        [torch.ones_like(clamped), *clamped.expand(degree, *clamped.shape).cumprod(0)]
    )
    return table, (scaled.abs() < RIM).to(coordinate.dtype)


@cache
def bend_monomials(terms: tuple[Term, ...]) -> Tensor:
    """Return the (n, orders^2) coefficients of the products u^a v^b in each term of a bend. Degree
    2 is 1 - u^2, u v and 1 - v^2: zero at the edges, with a mean that is not zero.
    """
    table = monomials(terms)
    for row, term in zip(table, terms, strict=True):
        if term in ((2, 0), (0, 2)):
            row[:] = 0.0
            row[0, 0], row[term] = 1.0, -1.0
    return torch.from_numpy(table).flatten(1)


def bend_weights(terms: tuple[Term, ...], u: Tensor, v: Tensor) -> Tensor:
    """Return the (..., n) height of each term of a bend at the (degree + 1, ...) powers of u and v,
    for a size of 1.
    """
    products = (u.unsqueeze(1) * v).flatten(0, 1).movedim(0, -1)
    return products @ bend_monomials(terms).to(u).mT


def bend_sigma(sigma: float, term: Term) -> float:
    """Return the prior standard deviation of a term of a bend, where `sigma` is that of degree 2.
    It falls with the square of the degree, as the curvature of a term grows with it.
    """
    return sigma * (2 / sum(term)) ** 2


def monomials(terms: Iterable[Term]) -> NDArray[np.float64]:
    """Return the (n, orders, orders) coefficients of the products u^a v^b in each term."""
    listed = tuple(terms)
    orders = 1 + max(max(term) for term in listed)
    table = np.zeros((len(listed), orders, orders))
    for row, (i, j) in zip(table, listed, strict=True):
        row[: i + 1, : j + 1] = np.outer(leg2poly([0] * i + [1]), leg2poly([0] * j + [1]))
    return table
