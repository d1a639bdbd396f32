"""A bundle of rays, and what became of those that did not arrive."""

from dataclasses import dataclass

import torch
from torch import Tensor

FAILURES = (
    "arrived",
    "the lens model cannot be inverted there",
    "missed the cover's inner surface",
    "totally reflected at the cover's inner surface",
    "missed the cover's outer surface",
    "totally reflected at the cover's outer surface",
    "missed the board's plane",
)
"""A ray's `failure` is an index into this tuple: the first thing that went wrong on its way, 0 where nothing did."""

LENS, MISSED_INNER, REFLECTED_INNER, MISSED_OUTER, REFLECTED_OUTER, MISSED_TARGET = range(1, 7)


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in the camera frame. A failed ray stays finite, and so do its gradients; `failure` says that it means nothing."""

    origin: Tensor
    """(..., 3) m"""
    direction: Tensor
    """(..., 3) unit"""
    failure: Tensor
    """(...) uint8, index into FAILURES"""

    def fail(self, where: Tensor, code: int) -> Tensor:
        """The failures with `code` entered where (...) bool is true and nothing went wrong before."""
        return torch.where((self.failure == 0) & where, torch.full_like(self.failure, code), self.failure)

    @property
    def ok(self) -> Tensor:
        """(...) bool, true for the rays that arrived."""
        return self.failure == 0


def unit(vectors: Tensor) -> Tensor:
    """(..., 3) scaled to length one."""
    return torch.nn.functional.normalize(vectors, dim=-1)
