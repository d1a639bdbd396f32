"""The simplest of several models that does about as well as the best of them."""

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


def simplest(errors: Mapping[T, float], tolerance: float) -> T:
    """The first model whose error is within a fraction `tolerance` of the least; simpler models
    stand first.
    """
    least = min(errors.values())
    return next(model for model, error in errors.items() if (1 - tolerance) * error <= least)
