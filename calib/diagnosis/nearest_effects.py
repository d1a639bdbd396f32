"""The named effects that come nearest to a field without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from calib.effects.effect import Effect
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import score_test, tuned_score_tests

MIN_SHARE = 0.1
"""The smallest fraction of the field that a reported effect explains."""
MAX_EFFECTS = 3
"""The number of reported effects."""


def nearest_named(
    fitted: FittedModel,
    field: Effect,
    values: dict[str, torch.Tensor],
    candidates: Sequence[Effect],
) -> list[tuple[str, float]]:
    """Return the effects that explain most of the shifts by a fitted field, beside the parameters
    of the fit without the field.

    Args:
        fitted: the fit without the field.
        values: the values of the fitted field.

    Returns:
        Names, and fractions of the field's sum of squares, the largest first.
    """
    vector = [
        (values[u.param.name] / u.param.scale).numpy().ravel() for u in field.effect_parameters
    ]
    shift = score_test(fitted, field).jacobian @ np.concatenate(vector)
    shares = dict[str, float]()
    for test in tuned_score_tests(fitted, candidates):
        if test.jacobian.size:  # parameters of single views could explain anything
            share = float(((test.span().T @ shift) ** 2).sum() / (shift @ shift))
            shares[test.effect.name] = max(share, shares.get(test.effect.name, 0.0))
    large = [(share, name) for name, share in shares.items() if share >= MIN_SHARE]
    return [(name, share) for share, name in sorted(large, reverse=True)[:MAX_EFFECTS]]
