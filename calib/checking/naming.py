"""Names of changes: one explanation that is almost sure, or all probable ones, with their sizes and
probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from calib.checking.changes import WORDS, size_of
from calib.checking.hypotheses import CheckedViews, Hypothesis
from calib.checking.result import Change
from calib.effects.effect import Effect
from calib.inference.naming import MIN_MEMBER_PROBABILITY, NAME_ALONE

Array = NDArray[np.float64]


class Explanation(Protocol):
    """Something that may have changed."""

    @property
    def log_evidence(self) -> float: ...


E = TypeVar("E", bound=Explanation)


def probabilities(ranking: Sequence[Explanation]) -> Array:
    """Return the (n,) probabilities of the explanations, given that one of them is true."""
    logs = np.array([explanation.log_evidence for explanation in ranking])
    odds = np.exp(logs - logs.max())
    return np.asarray(odds / odds.sum())


def probable_explanations(ranking: Sequence[E]) -> list[tuple[E, float]]:
    """Return the explanation that is almost sure, or else all probable ones, with their
    probabilities. `ranking` begins with the most probable one.
    """
    chances = probabilities(ranking).tolist()
    if chances[0] > NAME_ALONE:
        return [(ranking[0], chances[0])]
    return [
        (explanation, chance)
        for explanation, chance in zip(ranking, chances, strict=True)
        if chance > MIN_MEMBER_PROBABILITY
    ]


def name_changes(ranking: Sequence[Hypothesis], views: CheckedViews) -> tuple[Change, ...]:
    """Return the change that is almost sure, or else all probable changes."""
    return tuple(
        _describe(hypothesis, chance, views)
        for hypothesis, chance in probable_explanations(ranking)
    )


def rms_shift(hypothesis: Hypothesis, views: CheckedViews) -> float | None:
    """Return the root mean square shift of the checked corners in px that remains after their poses
    adapt to a change; None for a hypothesis without a size.
    """
    if not hypothesis.change:
        return None
    metric = _shift_metric(hypothesis.change, views)
    return math.sqrt(max(0.0, float(hypothesis.vector @ metric @ hypothesis.vector)))


def _describe(hypothesis: Hypothesis, chance: float, views: CheckedViews) -> Change:
    if not hypothesis.change:
        return Change(hypothesis.name, hypothesis.words, chance)
    vector, covariance = hypothesis.vector, hypothesis.covariance
    size = size_of(hypothesis.change, vector, covariance, _shift_metric(hypothesis.change, views))
    sigmas = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    numbers: list[tuple[str, float, float, str]] = []
    index = 0
    for unknown in hypothesis.change.effect_parameters:
        if not unknown.param.shape:
            scale = unknown.param.scale
            numbers.append(
                (
                    unknown.param.name,
                    float(vector[index] * scale),
                    float(sigmas[index] * scale),
                    unknown.param.unit,
                )
            )
        index += math.prod(unknown.param.shape)
    return Change(
        hypothesis.name,
        WORDS[hypothesis.name].start,
        chance,
        size.value,
        size.sigma,
        size.unit,
        tuple(numbers),
    )


def _shift_metric(change: Effect, views: CheckedViews) -> Array:
    """Return the (k, k) px^2 metric of `size_of`."""
    place = views.predictive.places[change.name]
    squares = views.predictive.products[:, place, place].sum(0)
    weight = float((views.observations.weight**2).mean())
    return np.asarray(squares * views.predictive.sigma**2 / weight / len(views.observations.pixels))
