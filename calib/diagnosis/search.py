"""The search for missing effects: forward selection, then backward elimination.

Each round adds one effect:

1. Every effect gets a score (`score_test`), which needs no fit.
2. The effects with the best scores are fitted. A fit with one further effect is a `Trial`.
3. The trials whose error is lower are evaluated on held-out views, the most probable first.
4. The first one that held-out views confirm is added. Its gain must be more than chance explains,
   after a correction for all candidates of the round (Bonferroni).

The search ends when no effect passes.

Effects that all views share come first. A number that each view has for itself can imitate almost
any error, so it is tried only if the views show that it differs between them.
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
    free_state = _with_all_numbers_free(state) if state.model.effects else None
    if not free_state:
        return state
    estimated = {param.name for param in state.model.parameters.free}
    is_worse = free_state.joint.sigma > MAX_INCREASE * state.joint.sigma
    return state if is_worse or largest_prior_conflict(free_state.joint, estimated) else free_state


def _with_all_numbers_free(state: SearchState) -> SearchState | None:
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
    """Score effects on the residual of the current fit.

    Returns:
        The state with these scores, and the tests of effects that are neither in the model nor
        dropped.
    """
    problem = state.problem
    locate = any(kind.needs_place for kind in kinds)
    context = effect_context(state.fitted_model, problem.board, problem.camera, locate=locate)
    return _score(state, [effect for kind in kinds for effect in kind.propose(context)])


def _score(state: SearchState, proposals: Sequence[Effect]) -> tuple[SearchState, list[ScoreTest]]:
    """Score these effects; the result is that of `score`."""
    excluded = state.dropped | {effect.name for effect in state.model.effects}
    proposals = [effect for effect in proposals if effect.name not in excluded]
    tests = tuned_score_tests(state.fitted_model, proposals)
    for test in tests:
        trial = state.trials.get((test.effect.name, test.effect.form))
        if trial is None or (not trial.gain and test.p_value < trial.test.p_value):
            state = state.with_trial(Trial(test))
    return _with_confounded(state, tests), tests


def _with_confounded(state: SearchState, tests: Sequence[ScoreTest]) -> SearchState:
    """Note pairs of effects that these views cannot tell apart: each direction in which the one
    with fewer parameters moves the corners is nearly one of the other's directions.
    """
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
    """Return the trial of the next effect to add; None if no effect passes.

    The kinds of effects are tried in this order:

    1. Effects that all views share. One is not added if it only imitates what differs from view to
       view.
    2. Numbers that differ from view to view (`Differing`).
    3. Smooth fields without a name, for a residual that is not noise. A field must be more probable
       than the numbers of step 2.
    """
    shared = [kind for kind in EFFECTS if not kind.per_view]
    state, trials = _promising_trials(*score(state, shared))
    state, best = _first_confirmed(state, trials, lambda fit: fit.joint.log_evidence)
    if best and not _imitates_variation(state, best) and _outdoes_discrepancy(state, best):
        return state, best
    state, variation = _trial_of_variation(state, len(shared))
    if not (variation or state.problem.has_structure(state.fit)):
        return state, None
    min_log_odds = 0.0
    if variation:
        min_log_odds = _log_marginal(variation.fitted) - state.joint.log_marginal
    state, tests = score(state, FIELDS)
    state, trials = _promising_trials(state, tests, len(EFFECTS), min_log_odds)
    state, fields = _more_probable_trials(state, trials)
    if variation:
        evidence = _log_marginal(variation.fitted)
        fields = [field for field in fields if _log_marginal(field.fitted) > evidence]
    state, best_field = _first_confirmed(state, fields, _log_marginal)
    return state, best_field or variation


def _trial_of_variation(
    state: SearchState, previous_candidates: int
) -> tuple[SearchState, Trial | None]:
    """Return the trial of the numbers that differ from view to view most probably, if held-out
    views confirm it. The views hardly tell some such numbers apart: all of these are fitted, and
    the fits decide.

    Args:
        previous_candidates: the number of candidates of this round so far.
    """
    differing = state.evaluations.differing
    if not differing:
        return state, None
    may_be_media = views_in_other_medium(state.fitted_model, LIKELY) is not None
    if may_be_media and (free_state := _with_all_numbers_free(state)):
        free_state, media = _trials_of_two_media(free_state, differing, previous_candidates)
        free_state, probable = _more_probable_trials(free_state, media)
        free_state, best = _first_confirmed(free_state, probable, _log_marginal)
        if best:
            return free_state, best
    _, context = state.problem.at_optimum(state.fit)
    state, media = _trials_of_two_media(state, differing, previous_candidates)
    gains = {trial.test.effect.name: trial.log_odds for trial in media}
    effects: list[Effect] = []
    for variation in differing.likely:
        for effect in variation.effects(context):
            gains[effect.name] = variation.gain
            if not (media and variation.group.is_medium):
                effects.append(effect)
    state, tests = _score(state, effects)
    state, trials = _promising_trials(state, tests, previous_candidates)
    state, probable = _more_probable_trials(state, trials + media)
    trials = [replace(trial, log_odds=gains[trial.test.effect.name]) for trial in probable]
    return _first_confirmed(state, trials, _log_marginal)


def _log_marginal(fit: ModelFit) -> float:
    """Return the log evidence with the views' own numbers integrated out."""
    return fit.joint.log_marginal


def _outdoes_discrepancy(state: SearchState, trial: Trial) -> bool:
    """Return True if an effect that all views share makes the views more probable even where the
    model is allowed a discrepancy, a smooth error of each view without a cause.

    This is asked only of models with numbers that differ from view to view: what differs is hardly
    ever modelled to the end, and any shared number follows the rest.
    """
    if not any(effect.varies or effect.per_view for effect in state.model.effects):
        return True
    without = log_evidence_beside_discrepancy(*state.problem.at_optimum(state.fit))
    with_trial = log_evidence_beside_discrepancy(*state.problem.at_optimum(trial.fitted))
    return with_trial > without + MIN_VARIATION_GAIN


def _imitates_variation(state: SearchState, trial: Trial) -> bool:
    """Return True if numbers differ from view to view, and an effect that all views share adds
    hardly anything to them: with both, the log evidence is hardly larger than with these numbers
    alone.
    """
    variation_alone = largest_log_evidence(*state.problem.at_optimum(state.fit))
    variation_and_effect = largest_log_evidence(*state.problem.at_optimum(trial.fitted))
    if variation_and_effect >= variation_alone + MIN_VARIATION_GAIN:
        return False
    return state.evaluations.differing is not None


def _promising_trials(
    state: SearchState,
    tests: Sequence[ScoreTest],
    previous_candidates: int = 0,
    min_log_odds: float = 0.0,
) -> tuple[SearchState, list[Trial]]:
    """Fit the effects with the best scores, and those that a score does not judge. Return the
    trials that are worth an evaluation on held-out views.

    Args:
        tests: the score tests of all candidates.
        previous_candidates: the number of candidates of this round so far.
        min_log_odds: the gain in log evidence that an effect must be able to reach. Half of its
            chi2 is the most that it can reach.
    """
    promising = [
        test
        for test in tests
        if test.effect.judged_by_score
        and test.chi2 / 2 > min_log_odds
        and test.p_value < MAX_SCORE_P_VALUE
        and test.promises > MIN_GAIN
    ]
    promising.sort(key=lambda test: 2 * test.dof - test.chi2)  # Akaike's criterion
    unscored = [
        test
        for test in tests
        if not test.effect.judged_by_score
        and (test.effect.name, test.effect.form) not in state.hopeless
    ]
    trials = []
    for test in unscored + promising[:MAX_FITS]:
        state, trial = _fit_trial(state, test, previous_candidates + len(tests))
        trials.append(trial)
    return state, [trial for trial in trials if _is_promising(trial)]


def _trials_of_two_media(
    state: SearchState, differing: Differing, previous_candidates: int
) -> tuple[SearchState, list[Trial]]:
    """Return the trial of some views in air and the others in water, if it lowers the error; else
    none. The step between the media is often too large to show in the numbers that differ around
    one fit to all views.
    """
    divisions = [
        variation.pattern > variation.pattern.mean()
        for variation in differing.likely
        if variation.kind in (VariationKind.STEP, *TWO)
    ]
    candidates = previous_candidates + len(differing.likely)
    fit = fit_of_two_media(state.fitted_model, divisions)
    if not fit:
        return state, []
    state, tests = _score(state, fit.model.effects[-1:])
    trials = []
    for test in tests:
        state, trial = _fit_trial(state, test, candidates + 1, fit.joint)
        trials.append(trial)
    return state, [trial for trial in trials if _is_promising(trial)]


def _is_promising(trial: Trial) -> bool:
    """Return True if an effect is possible and lowers the error of the fitted views by enough to be
    worth an evaluation on held-out views.
    """
    return trial.error_decrease > MIN_GAIN and not (trial.improbable or trial.impossible)


def _fit_trial(
    state: SearchState, test: ScoreTest, candidates: int, fit: JointFit | None = None
) -> tuple[SearchState, Trial]:
    """Return the trial of an effect, and note it in the state.

    Args:
        test: the score test of the effect.
        candidates: the number of candidates of the round, for the Bonferroni correction.
        fit: a fit with the effect; None to fit it here, roughly.
    """
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
        among=candidates,
        log_odds=log_odds if shared else -np.inf,
        improbable=shared and log_odds <= 0,
        impossible=joint.finite and is_impossible(test.effect, joint),
    )
    if joint.finite and error_decrease < 1 - HOPELESS_RATIO:
        state = replace(state, hopeless=state.hopeless | {trial.key})
    if not state.trials[trial.key].gain:
        state = state.with_trial(trial)
    return state, trial


def _more_probable_trials(
    state: SearchState, trials: Sequence[Trial]
) -> tuple[SearchState, list[Trial]]:
    """Return the trials, in their most probable forms, whose evidence is larger than that of the
    current model. The views' own numbers are integrated out, because these models have different
    ones.
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


def _first_confirmed(
    state: SearchState, trials: Sequence[Trial], evidence: Callable[[ModelFit], float]
) -> tuple[SearchState, Trial | None]:
    """Evaluate trials on held-out views, the one with the largest evidence first, and return the
    first that passes; None if none does.
    """
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
