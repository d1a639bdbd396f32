"""The choice of the simplest model whose error is close to the lowest."""

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


def simplest_model(errors: Mapping[T, float], tolerance: float) -> T:
    """Return the first model whose error is within a fraction `tolerance` of the lowest; the
    mapping lists simpler models first.
    """
    lowest = min(errors.values())
    return next(model for model, error in errors.items() if (1 - tolerance) * error <= lowest)
