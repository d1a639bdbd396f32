"""What changed, in words: one explanation that is almost sure, or all that are worth naming, with
their sizes and probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.checking.answer import Change
from calib.checking.changes import WORDS, size_of
from calib.checking.hypotheses import Hypothesis, Seen
from calib.diagnosis.families import ALONE, WORTH_NAMING
from calib.effects.effect import Effect

Array = NDArray[np.float64]


def probabilities(found: Sequence[Hypothesis]) -> Array:
    """(n,) of each, one of them being so."""
    logs = np.array([one.log_evidence for one in found])
    odds = np.exp(logs - logs.max())
    return np.asarray(odds / odds.sum())


def named(found: Sequence[Hypothesis], seen: Seen) -> tuple[Change, ...]:
    """One that is almost sure, alone; else all that are worth naming."""
    chances = probabilities(found)
    worth = [
        (one, float(chance))
        for one, chance in zip(found, chances, strict=True)
        if chance > WORTH_NAMING
    ]
    if worth[0][1] > ALONE:
        worth = worth[:1]
    return tuple(_told(one, chance, seen) for one, chance in worth)


def shift_of(one: Hypothesis, seen: Seen) -> float:
    """px, root mean square, by which a change moves the checked corners, their poses adapted; NaN
    of one that has no size.
    """
    return (
        max(0.0, float(one.vector @ _shift(one.change, seen) @ one.vector)) ** 0.5
        if one.change
        else float("nan")
    )


def _told(one: Hypothesis, chance: float, seen: Seen) -> Change:
    if not one.change:
        return Change(one.name, one.words, chance)
    vector, covariance = one.vector, one.covariance
    size = size_of(one.change, vector, covariance, _shift(one.change, seen))
    sigmas = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    numbers: list[tuple[str, float, float, str]] = []
    at = 0
    for unknown in one.change.effect_parameters:
        if not unknown.param.shape:
            scale = unknown.param.scale
            numbers.append(
                (
                    unknown.param.name,
                    float(vector[at] * scale),
                    float(sigmas[at] * scale),
                    unknown.param.unit,
                )
            )
        at += math.prod(unknown.param.shape)
    return Change(
        one.name, WORDS[one.name].before, chance, size.value, size.sigma, size.unit, tuple(numbers)
    )


def _shift(change: Effect, seen: Seen) -> Array:
    """(k, k) px^2 as `size_of` has it."""
    place = seen.equations.places[change.name]
    squares = seen.equations.products[:, place, place].sum(0)
    weight = float((seen.observations.weight**2).mean())
    return np.asarray(squares * seen.equations.sigma**2 / weight / len(seen.observations.pixels))
