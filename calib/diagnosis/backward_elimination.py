"""Backward elimination: effects that later ones make idle are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.diagnosis.search_state import SearchState, effects_without
from calib.diagnosis.trial import MIN_GAIN, is_worthwhile
from calib.effects.effect import Effect
from calib.estimation.joint_fit import ROUNDS
from calib.inference.cross_validation import held_out_gain
from calib.inference.fitted_model import ModelFit
from calib.inference.vuong import vuong_statistic

MAX_P_VALUE = 0.05
"""The largest p-value at which an accepted effect counts as needed beside later ones."""
CLEAR_GAIN = 3.0
"""A multiple of the smallest gain: with a larger one, an effect may be needed without held-out
tests.
"""
CLEAR_AGREEMENT = 6.0
"""The Vuong statistic above which an effect is needed without held-out tests."""


def drop_idle(state: SearchState, newest: Effect | None = None) -> tuple[SearchState, bool]:
    """Drop effects that are no longer needed, the oldest first; return True if there were any.

    The newest effect was just confirmed, and stays. A shared effect is compared with shared effects
    only: per-view parameters can imitate it and must not displace it, unless the evidence without
    it is larger with those parameters integrated out.
    """
    dropped = state.dropped
    for effect in state.model.effects:
        if effect is newest or _is_clearly_needed(state, effect, state.model.effects):
            continue
        imitated = state.model.path.has_private_blocks and not effect.per_view
        idle = not imitated and _is_idle(state, effect)
        if not (idle or imitated):
            continue
        without = drop_effect(state, effect)
        if without is state:
            continue
        is_better = without.joint.log_marginal > state.joint.log_marginal
        if idle or is_better or _is_idle(state, effect):
            state = without
    return state, state.dropped != dropped


def drop_effect(state: SearchState, effect: Effect) -> SearchState:
    """Return the state without an effect that was accepted; the same state if no fit without it is
    finite.
    """
    fit = state.evaluations.refit_without(effect)
    observations = state.problem.observations
    joint = fit.model.fit(observations, fit.joint.poses, fit.joint.start, ROUNDS)
    if not joint.finite:
        return state
    state = state.with_fit(ModelFit(fit.model, joint))
    return replace(state, dropped=state.dropped | {effect.name})


def _is_clearly_needed(state: SearchState, effect: Effect, effects: Sequence[Effect]) -> bool:
    """Return True if an effect is needed beside `effects` without a held-out test: the fit without
    it is much worse, and the views agree on that.
    """
    extended = state.evaluations.refit_with(effects)
    base = state.evaluations.refit_with(effects_without(effect, effects))
    error_increase = (base.joint.cost / extended.joint.cost) ** 0.5 - 1
    if error_increase <= CLEAR_GAIN * MIN_GAIN:
        return False
    difference = extended.joint.log_marginal - base.joint.log_marginal
    statistic = vuong_statistic(extended, base, difference, state.problem.observations)
    return statistic > CLEAR_AGREEMENT


def _is_idle(state: SearchState, effect: Effect) -> bool:
    """Return True if held-out views do not need the effect beside effects of its kind."""
    effects = [e for e in state.model.effects if effect.per_view or not e.per_view]
    if _is_clearly_needed(state, effect, effects):
        return False
    half = any(e.per_view for e in effects)
    evaluations = state.evaluations
    if len(effects) == len(state.model.effects):
        extended = evaluations.held_out_errors()
    else:
        extended = evaluations.held_out_errors_with(effects, half=half)
    base = evaluations.held_out_errors_with(effects_without(effect, effects), half=half)
    gain = held_out_gain(base, extended)
    p_value = min(gain.p_value, gain.presence_p_value)
    return p_value > MAX_P_VALUE or not is_worthwhile(gain)
