"""The search for missing effects: forward selection, then backward elimination.

In each round every effect is scored (score_test), and the best few are fitted. The one that lowers
the error on held-out views most is added, if its gain is more than chance after a correction for
all candidates of the round (Bonferroni). The search ends when no effect passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from calib.diagnosis.backward_elimination import drop_idle
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.search_state import Evaluations, SearchState
from calib.diagnosis.simpler_forms import simplified
from calib.diagnosis.trial import MIN_GAIN, Trial, is_impossible
from calib.effects.effect import Effect
from calib.effects.registry import EFFECTS, FIELDS
from calib.estimation.joint_fit import JointFit
from calib.estimation.prior_conflict import largest_prior_conflict
from calib.fitting.differing import Differing
from calib.inference.cross_validation import held_out_gain, hold_out
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import ModelFit
from calib.inference.media_of_views import LIKELY, fit_of_two_media, views_in_other_medium
from calib.inference.score_test import ScoreTest, tuned_score_tests
from calib.inference.varying_numbers import TWO, VariationKind
from calib.inference.view_variation import MIN_GAIN as MIN_VARIATION_GAIN
from calib.inference.view_variation import (
    largest_log_evidence,
    log_evidence_beside_discrepancy,
)
from calib.inference.warm_start import rough_fit

MAX_SCORE_P_VALUE = 0.05
"""The largest p-value of the score of a candidate that is fitted."""
MAX_FITS = 4
"""The number of candidates that are fitted in a round, best scores first. Candidates whose score at
the neutral point says little are fitted in addition.
"""
HOPELESS_RATIO = 3.0
"""The ratio of the errors with and without an effect above which it is not tried again."""
MAX_EFFECTS = 6
"""The largest number of effects. Dropping an idle effect makes room for another."""
MAX_INCREASE = 1.01
"""The error with free numbers over that with held ones: they lower it, or the fit ended elsewhere.
"""
MIN_CONFOUNDED_CORRELATION = 0.9
"""The squared correlation above which two effects are the same to these views."""


def run_search(state: SearchState) -> SearchState:
    """Add the missing effects and drop those that others make idle."""
    previous = state.model
    state = _add_effects(state)
    added = state.model is not previous
    is_full = len(state.model.effects) == MAX_EFFECTS
    while True:
        # Without an addition, the effects of an earlier diagnosis may still be idle.
        state, dropped = drop_idle(state, state.model.effects[-1] if added else None)
        if not (dropped and is_full):
            return state
        previous = state.model
        state = _add_effects(state)
        if state.model is previous:
            return state
        added = True
        is_full = len(state.model.effects) == MAX_EFFECTS


def with_free_numbers(state: SearchState) -> SearchState:
    """Estimate the declared numbers that the fit held because its model lacked something, if the
    effects leave the estimates within their tolerances.

    Held at values that are off by their tolerances, they leave an error that other effects imitate.
    """
    freed = _numbers_freed(state) if state.model.effects else None
    if not freed:
        return state
    estimated = {param.name for param in state.model.parameters.free}
    is_worse = freed.joint.sigma > MAX_INCREASE * state.joint.sigma
    return state if is_worse or largest_prior_conflict(freed.joint, estimated) else freed


def _numbers_freed(state: SearchState) -> SearchState | None:
    """Return the state with a fit of the declared numbers that it holds; None if it holds none, or
    that fit is not finite.
    """
    free_base = state.problem.free_base
    if not free_base:
        return None
    model = free_base.with_effects(state.model.effects)
    joint = model.fit(state.problem.observations, state.joint.poses, state.joint.start)
    problem = replace(state.problem, base=free_base, free_base=None)
    evaluations = Evaluations(problem, ModelFit(model, joint), {})
    return replace(state, problem=problem, evaluations=evaluations) if joint.finite else None


def simplify(state: SearchState) -> SearchState:
    """Give effects simpler forms where these are more probable."""
    fit = simplified(state.fit, state.problem.base, state.problem.observations)
    return state if fit.model is state.model else state.with_fit(fit)


def score(state: SearchState, kinds: Sequence[type[Effect]]) -> tuple[SearchState, list[ScoreTest]]:
    """Score effects on the residual of the current fit."""
    problem = state.problem
    locate = any(kind.needs_place for kind in kinds)
    context = effect_context(state.fitted_model, problem.board, problem.camera, locate=locate)
    return _score(state, [effect for kind in kinds for effect in kind.propose(context)])


def _score(state: SearchState, proposals: Sequence[Effect]) -> tuple[SearchState, list[ScoreTest]]:
    excluded = state.dropped | {effect.name for effect in state.model.effects}
    proposals = [effect for effect in proposals if effect.name not in excluded]
    tests = tuned_score_tests(state.fitted_model, proposals)
    for test in tests:
        trial = state.trials.get((test.effect.name, test.effect.form))
        if trial is None or (not trial.gain and test.p_value < trial.test.p_value):
            state = state.with_trial(Trial(test))
    return _with_confounded(state, tests), tests


def _with_confounded(state: SearchState, tests: Sequence[ScoreTest]) -> SearchState:
    """Note pairs of effects where one can do all that the other, of fewer directions, does."""
    spans = [(test.effect.name, test.span()) for test in tests if test.jacobian.size]
    confounded = dict(state.confounded)
    for (first, first_span), (second, second_span) in combinations(spans, 2):
        if first == second or not (first_span.size and second_span.size):
            continue
        correlations = np.linalg.svd(first_span.T @ second_span, compute_uv=False)
        if correlations[-1] ** 2 > MIN_CONFOUNDED_CORRELATION:
            confounded[first] = confounded.get(first, frozenset()) | {second}
            confounded[second] = confounded.get(second, frozenset()) | {first}
    return replace(state, confounded=confounded)


def _add_effects(state: SearchState) -> SearchState:
    """Add effects, one after the other, as long as one passes."""
    while len(state.model.effects) < MAX_EFFECTS:
        state, trial = _best_trial(state)
        if trial is None:
            break
        state = _accept(state, trial)
    return state


def _best_trial(state: SearchState) -> tuple[SearchState, Trial | None]:
    """Return the next effect to add.

    A number of each view's own can imitate almost any error. So it is tried only if it differs from
    view to view (`Differing`). The most probable such number is fitted, and those that the views
    hardly tell from it: the fits decide. An effect that all views share is not added if it only
    imitates what differs.
    """
    shared = [kind for kind in EFFECTS if not kind.per_view]
    state, lowering = _lowering(*score(state, shared))
    state, best = _first_passing(state, lowering, lambda fit: fit.joint.log_evidence)
    if best and not _is_imitation(state, best) and _is_named(state, best):
        return state, best
    state, cause = _most_probable_cause(state, len(shared))
    if not (cause or state.problem.has_structure(state.fit)):
        return state, cause
    lead = cause.fitted.joint.log_marginal - state.joint.log_marginal if cause else 0.0
    scored = score(state, FIELDS)
    state, lowering = _lowering(*scored, previous=len(EFFECTS), min_log_odds=lead)
    state, fields = _more_probable(state, lowering)
    if cause:
        evidence = cause.fitted.joint.log_marginal
        fields = [field for field in fields if field.fitted.joint.log_marginal > evidence]
    state, field = _first_passing(state, fields, _log_marginal)
    return state, field or cause


def _most_probable_cause(state: SearchState, previous: int) -> tuple[SearchState, Trial | None]:
    """Return the trial of what differs from view to view most probably, if held-out views confirm
    it.

    Args:
        previous: the number of candidates before.
    """
    differing = state.evaluations.differing
    if not differing:
        return state, None
    may_be_media = views_in_other_medium(state.fitted_model, LIKELY) is not None
    if may_be_media and (freed := _numbers_freed(state)):
        freed, media = _two_media(freed, differing, previous)
        freed, cause = _first_passing(*_more_probable(freed, media), _log_marginal)
        if cause:
            return freed, cause
    _, context = state.problem.at_optimum(state.fit)
    state, media = _two_media(state, differing, previous)
    gains = {trial.test.effect.name: trial.log_odds for trial in media}
    effects: list[Effect] = []
    for variation in differing.likely:
        for effect in variation.effects(context):
            gains[effect.name] = variation.gain
            if not (media and variation.group.is_medium):
                effects.append(effect)
    state, lowering = _lowering(*_score(state, effects), previous=previous)
    state, probable = _more_probable(state, lowering + media)
    causes = [replace(trial, log_odds=gains[trial.test.effect.name]) for trial in probable]
    return _first_passing(state, causes, _log_marginal)


def _log_marginal(fit: ModelFit) -> float:
    return fit.joint.log_marginal


def _is_named(state: SearchState, trial: Trial) -> bool:
    """Return True if an effect that all views share is more probable beside structure of no cause,
    or nothing in the model differs from view to view. What differs is hardly ever modelled to the
    end, and any number follows the rest.
    """
    if not any(effect.varies or effect.per_view for effect in state.model.effects):
        return True
    without = log_evidence_beside_discrepancy(*state.problem.at_optimum(state.fit))
    with_trial = log_evidence_beside_discrepancy(*state.problem.at_optimum(trial.fitted))
    return with_trial > without + MIN_VARIATION_GAIN


def _is_imitation(state: SearchState, trial: Trial) -> bool:
    """Return True if an effect that all views share adds nothing to numbers that differ from view
    to view: with both, the log evidence is hardly larger than with these numbers alone.
    """
    alone = largest_log_evidence(*state.problem.at_optimum(state.fit))
    both = largest_log_evidence(*state.problem.at_optimum(trial.fitted))
    if both >= alone + MIN_VARIATION_GAIN:
        return False
    return state.evaluations.differing is not None


def _lowering(
    state: SearchState,
    tests: Sequence[ScoreTest],
    previous: int = 0,
    min_log_odds: float = 0.0,
) -> tuple[SearchState, list[Trial]]:
    """Fit the effects of the best scores, and return those that lower the error enough to hold
    views out.

    Args:
        previous: the number of candidates that did not pass before.
        min_log_odds: the gain in log evidence that an effect must be able to reach, which is at
            most half of its chi2.
    """
    promising = [
        test
        for test in tests
        if test.effect.judged_by_score
        and test.chi2 / 2 > min_log_odds
        and test.p_value < MAX_SCORE_P_VALUE
        and test.promises > MIN_GAIN
    ]
    unscored = [
        test
        for test in tests
        if not test.effect.judged_by_score
        and (test.effect.name, test.effect.form) not in state.hopeless
    ]
    promising.sort(key=lambda test: 2 * test.dof - test.chi2)
    trials = []
    for test in unscored + promising[:MAX_FITS]:
        state, trial = _fit_trial(state, test, previous + len(tests))
        trials.append(trial)
    return state, list(filter(_lowers, trials))


def _two_media(
    state: SearchState, differing: Differing, previous: int
) -> tuple[SearchState, list[Trial]]:
    """Return the trial of some views in air and the others in water, if it lowers the error. That
    is often too large a change to be seen in what differs around one fit to both.
    """
    divisions = [
        variation.pattern > variation.pattern.mean()
        for variation in differing.likely
        if variation.kind in (VariationKind.STEP, *TWO)
    ]
    previous += len(differing.likely)
    fit = fit_of_two_media(state.fitted_model, divisions)
    if not fit:
        return state, []
    state, tests = _score(state, fit.model.effects[-1:])
    trials = []
    for test in tests:
        state, trial = _fit_trial(state, test, previous + 1, fit.joint)
        trials.append(trial)
    return state, list(filter(_lowers, trials))


def _lowers(trial: Trial) -> bool:
    """Return True if an effect is possible and lowers the error enough to hold views out."""
    return trial.error_decrease > MIN_GAIN and not (trial.improbable or trial.impossible)


def _fit_trial(
    state: SearchState, test: ScoreTest, among: int, fit: JointFit | None = None
) -> tuple[SearchState, Trial]:
    """Fit a candidate to all views, roughly, if that is not done."""
    state.problem.report(f"trying {test.effect.name}")
    model = state.model.with_effect(test.effect)
    joint = fit or rough_fit(model, state.problem.observations, state.joint)
    error_decrease = -np.inf
    log_odds = -np.inf
    if joint.finite:
        error_decrease = 1 - (joint.cost / state.joint.cost) ** 0.5
        log_odds = joint.log_evidence - state.joint.log_evidence
    shared = not test.effect.per_view
    trial = Trial(
        test=test,
        fit=ModelFit(model, joint),
        error_decrease=error_decrease,
        among=among,
        log_odds=log_odds if shared else -np.inf,
        improbable=shared and log_odds <= 0,
        impossible=joint.finite and is_impossible(test.effect, joint),
    )
    if joint.finite and error_decrease < 1 - HOPELESS_RATIO:
        state = replace(state, hopeless=state.hopeless | {trial.key})
    if not state.trials[trial.key].gain:
        state = state.with_trial(trial)
    return state, trial


def _more_probable(state: SearchState, trials: Sequence[Trial]) -> tuple[SearchState, list[Trial]]:
    """Return the trials, in their most probable forms, whose evidence is larger than that of the
    current model. It compares models whose numbers of parameters have no common measure.
    """
    probable = []
    for trial in trials:
        model, joint = with_most_probable(
            state.model, trial.test.effect, state.problem.observations, trial.fitted.joint
        )
        trial = replace(
            trial,
            fit=ModelFit(model, joint),
            finished=True,
            log_odds=-np.inf,
            improbable=joint.log_marginal <= state.joint.log_marginal,
        )
        if trial.improbable:
            state = state.with_trial(trial)
        else:
            probable.append(trial)
    return state, probable


def _first_passing(
    state: SearchState, trials: Sequence[Trial], evidence: Callable[[ModelFit], float]
) -> tuple[SearchState, Trial | None]:
    """Return the most probable trial that held-out views confirm."""
    for trial in sorted(trials, key=lambda trial: evidence(trial.fitted), reverse=True):
        state, evaluated = _hold_out_trial(state, trial)
        if evaluated.passes:
            return state, evaluated
    return state, None


def _hold_out_trial(state: SearchState, trial: Trial) -> tuple[SearchState, Trial]:
    """Return the trial with its gain on held-out views."""
    problem = state.problem
    model = trial.fitted.model
    joint = trial.fitted.joint
    if not trial.finished:  # finish the fit once, or every fold must
        joint = model.fit(problem.observations, joint.poses, joint.start)
        trial = replace(trial, fit=ModelFit(model, joint))
    half = model.path.has_private_blocks
    errors = hold_out(model, problem.observations, joint, problem.folds, half=half)
    base_errors = state.evaluations.held_out_errors(half=half)
    trial = replace(trial, gain=held_out_gain(base_errors, errors))
    if trial.large and problem.depth_bands:
        errors = hold_out(model, problem.observations, joint, problem.depth_bands, half=half)
        base_errors = state.evaluations.held_out_errors(half=half, by_depth=True)
        trial = replace(trial, depth_gain=held_out_gain(base_errors, errors))
    best = state.trials[trial.key].gain
    if not (best and trial.gain and best.relative > trial.gain.relative):
        state = state.with_trial(trial)
    return state, trial


def _accept(state: SearchState, trial: Trial) -> SearchState:
    """Add an effect and estimate noise and prior again; if that fit is not finite, the fit of the
    trial is taken.
    """
    fit = trial.fitted
    if not trial.finished:
        model, joint = with_most_probable(
            state.model, trial.test.effect, state.problem.observations, fit.joint
        )
        fit = ModelFit(model, joint) if joint.finite else fit
    state = state.with_fit(fit, keep_previous=True)
    state.problem.report(f"found {trial.test.effect.name}")
    return with_free_numbers(state)
