"""Parts of a ray path whose own parameters enter linearly, and values whose slopes are known.

What such a part gives grows by its weights times its parameters. So one probe for each coordinate,
which is added to what it gives, says by
its derivative what all of them do: as many reverse passes over as little as there is, for any
    number of parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor


@runtime_checkable
class LinearPart(Protocol):
    """A part of the path that reads its probes, where the values have them."""

    @property
    def probes(self) -> Mapping[str, str]:
        """For each of its parameters the probe that it acts through, by name."""
        ...

    def weights(self, x: Tensor, y: Tensor) -> Mapping[str, Tensor]:
        """For each of its parameters the (M, n) by which its probe grows with it, at (M,)
        coordinates.
        """
        ...


def sloped(value: Tensor, x: Tensor, y: Tensor, by_x: Tensor, by_y: Tensor) -> Tensor:
    """(...) a value with the slopes that are known of it: nothing needs to be kept of how it was
    made.
    """
    if not (torch.is_grad_enabled() and (x.requires_grad or y.requires_grad)):
        return value
    return value + by_x.detach() * (x - x.detach()) + by_y.detach() * (y - y.detach())


def times(along: Tensor, table: Tensor) -> Tensor:
    """(n, ...) times (n, k), one for all or (..., n, k) one for each: (k, ...)."""
    return (
        torch.tensordot(table, along, ([0], [0]))
        if table.ndim == 2
        else torch.einsum("...ij,i...->j...", table, along)
    )
