"""Terms of a ray path that are linear in their parameters, and values with given slopes.

The output of such a term is its weights times its parameters. So a fit adds one probe to each
coordinate of that output and differentiates by the probe; the derivatives by all parameters are the
weights times this one. The number of reverse passes does not depend on the number of parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor


@runtime_checkable
class LinearTerm(Protocol):
    """A term of the path that adds its probes, if the values hold them, to its output."""

    @property
    def probes(self) -> Mapping[str, str]:
        """The name of the probe through which each parameter acts, by the parameter's name."""
        ...

    def weights(self, x: Tensor, y: Tensor) -> Mapping[str, Tensor]:
        """Return for each parameter the (M, n) derivatives of its probe by its n entries, at (M,)
        coordinates.
        """
        ...


def with_slopes(value: Tensor, x: Tensor, y: Tensor, by_x: Tensor, by_y: Tensor) -> Tensor:
    """Return the (...) value with the slopes `by_x` and `by_y` as its derivatives by x and y, so
    that the value itself can be computed without a graph.
    """
    if not (torch.is_grad_enabled() and (x.requires_grad or y.requires_grad)):
        return value
    return value + by_x.detach() * (x - x.detach()) + by_y.detach() * (y - y.detach())


def contract(basis: Tensor, table: Tensor) -> Tensor:
    """Return the (k, ...) sums over n of an (n, ...) basis times a table: (n, k) for all points, or
    (..., n, k) with one table for each point.
    """
    return (
        torch.tensordot(table, basis, ([0], [0]))
        if table.ndim == 2
        else torch.einsum("...ij,i...->j...", table, basis)
    )
