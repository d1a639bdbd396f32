"""Which named effects come nearest to a field without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from calib.diagnosis.score_test import Optimum
from calib.effects.effect import Effect

NEAR = 0.1
"""The part of the field that a named effect must be able to do, to be worth a word."""
MOST = 3
"""Of the names."""


def nearest_named(
    at: Optimum, field: Effect, values: dict[str, torch.Tensor], named: Sequence[Effect]
) -> list[tuple[str, float]]:
    """What each named effect can do of the shifts that a fitted field makes, beside what the fit
    without either can do, best first.

    Args:
        at: where the fit without the field ended.
        values: of the fitted field.

    Returns:
        Names, and fractions of the field's sum of squares.
    """
    columns = at.test(field).jacobian
    moved = columns @ np.concatenate(
        [(values[u.param.name] / u.param.scale).numpy().ravel() for u in field.effect_parameters]
    )
    shares = dict[str, float]()
    for scored in at.candidates(named):
        if scored.jacobian.size:  # parameters of every view could do anything
            share = float(((scored.span().T @ moved) ** 2).sum() / (moved @ moved))
            shares[scored.effect.name] = max(share, shares.get(scored.effect.name, 0.0))
    near = sorted(((share, name) for name, share in shares.items() if share >= NEAR), reverse=True)
    return [(name, share) for share, name in near[:MOST]]
