"""Effects that these views cannot tell apart: the rivals of every accepted effect with their
probabilities.

Each accepted effect is removed, and every other effect that can do much of what it does is fitted
in its place. Their marginal likelihoods are compared (Bayes factors, with the prior odds of the
effects). A name stands alone if it is almost sure, with equal prior odds too; otherwise it is the
most probable member of a family.

Source: R. E. Kass, A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from calib.diagnosis.backward_elimination import drop_effect, drop_idle
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.search import simplify
from calib.diagnosis.search_state import SearchState
from calib.diagnosis.sentences import separation
from calib.diagnosis.trial import Trial, is_impossible
from calib.effects.effect import Effect, EffectContext
from calib.effects.registry import KINDS
from calib.effects.varying import Varying
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.fit_record.history import Family
from calib.fitting.differing import ADVICE, EVIDENCE_SCALE, Differing, evidence_scale
from calib.inference.cross_validation import held_out_gain
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel, ModelFit
from calib.inference.naming import MIN_MEMBER_PROBABILITY, NAME_ALONE
from calib.inference.score_test import ScoreTest, score_test, tuned_score_tests
from calib.inference.varying_numbers import groups_of
from calib.inference.view_variation import largest_gain
from calib.inference.vuong import prior_difference, vuong_statistic
from calib.inference.warm_start import rough_fit

MIN_OVERLAP = 0.5
"""The smallest part of an accepted effect that a rival can do: of the squares of its shifts that
other parameters cannot do; if one of the two has parameters of single views, of the decrease of the
sum of squares.
"""
HOPELESS_STATISTIC = 12.0
"""The Vuong statistic above which a rival is excluded after its rough fit."""
HOPELESS_PART = 0.5
"""The part of an effect's gain in log evidence that numbers of single views must be able to reach.
A tenth of the gain counts as 1 (`evidence_scale`), so those with half of it have odds of 1 to 150.
"""
MAX_PASSES = 3
"""The largest number of comparisons of each effect. Replacing an effect changes the rivals of the
others.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another effect in the place of an accepted one."""

    test: ScoreTest
    base: CameraModel
    """The model with neither effect."""
    fit: ModelFit
    """The fit with the rival."""


def find_families(state: SearchState) -> tuple[SearchState, tuple[Family, ...]]:
    """Return the families of the accepted effects.

    A more probable rival replaces an accepted effect. If the rival differs from view to view and
    has no name there, the effect is dropped instead. Effects that then become idle are dropped, and
    the others get the simplest forms that suffice.
    """
    state = simplify(state)
    previous = state.model
    state, families = _compare_all(state)
    if state.model is previous:
        return state, families
    previous = state.model
    state, _ = drop_idle(state)
    state = simplify(state)
    return (state, families) if state.model is previous else _compare_all(state)


def _compare_all(state: SearchState) -> tuple[SearchState, tuple[Family, ...]]:
    """Compare every effect with its rivals, again after each replacement."""
    results = dict[str, tuple[CameraModel, Family | None]]()
    for _ in range(MAX_PASSES * len(state.model.effects)):
        stale = [
            effect
            for effect in state.model.effects
            if effect.name not in results or results[effect.name][0] is not state.model
        ]
        if not stale:
            break
        state, name, family = _compare(state, stale[0])
        results[name] = state.model, family
    families = [results[e.name][1] for e in state.model.effects if e.name in results]
    return state, tuple(family for family in families if family)


def _compare(state: SearchState, effect: Effect) -> tuple[SearchState, str, Family | None]:
    """Compare an effect with its rivals.

    Returns:
        The state, in which the most probable rival may have replaced the effect; the name of the
        most probable one; and the family, if it is not almost sure.
    """
    rivals = [
        rival for rival in _rivals(state, effect) if np.isfinite(rival.fit.joint.log_marginal)
    ]
    unmodelled = _unmodelled(state, effect)
    members = [effect, *(rival.test.effect for rival in rivals)]
    fits = [state.fit, *(rival.fit for rival in rivals)]
    likeliest = int(np.argmax([fit.joint.log_marginal for fit in fits]))
    observations = state.problem.observations
    scale = 1.0
    if any(member.varies for member in members):
        scale = _evidence_scale(state, effect, members[likeliest], fits[likeliest])
    scales = [scale if m.varies or members[likeliest].varies else 1.0 for m in members]
    odds = np.array(
        [
            _odds(fit, fits[likeliest], observations, scale)
            for fit, scale in zip(fits, scales, strict=True)
        ]
    )
    equal_prior = odds / odds.sum()
    weighted = odds * [member.prior_odds for member in members]
    probabilities = weighted / weighted.sum()
    best = int(np.argmax(probabilities))
    if best and members[best].varies and not _has_name(state, effect, members[best]):
        # something without a name differs from view to view, and a part of it looks like the effect
        return (drop_effect(state, effect) if effect.has_cause else state), effect.name, None
    if best:
        state = _replace_effect(state, rivals[best - 1])
    name = members[best].name
    is_sure = min(probabilities[best], equal_prior[best]) >= NAME_ALONE  # by these views alone, too
    if is_sure and not unmodelled:
        return state, name, None
    reported = [
        index
        for index in np.argsort(-probabilities, kind="stable")
        if max(probabilities[index], equal_prior[index]) > MIN_MEMBER_PROBABILITY
    ]
    family = [members[index] for index in reported]
    shares = {member.name: float(probabilities[members.index(member)]) for member in family}
    subject = " or ".join(dict.fromkeys(member.about for member in family))
    experiment = separation(state, family[0], family[1:])
    if unmodelled:
        modelled = 1 - sum(unmodelled.values())
        shares = unmodelled | {key: modelled * value for key, value in shares.items()}
        likeliest_name = max(unmodelled, key=lambda key: unmodelled[key])
        if unmodelled[likeliest_name] > 0.5:
            experiment = f"To find out, {ADVICE[likeliest_name]}."
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return state, name, Family(f"something about {subject}", dict(ordered), experiment)


def _has_name(state: SearchState, effect: Effect, rival: Effect) -> bool:
    """Return True if numbers that differ from view to view would have a name without an effect: a
    rival without one describes a part of an error that has no name either.
    """
    fitted, context = _without(state, effect)
    differing = Differing.of(fitted, context) if fitted.joint.finite else None
    variations = differing.variations if differing else ()
    return rival.name in {named.name for v in variations for named in v.effects(context)}


def _evidence_scale(state: SearchState, effect: Effect, likeliest: Effect, fit: ModelFit) -> float:
    """Return the difference in log evidence that counts as 1 beside what differs from view to view:
    little if a cause that all views share leaves nothing but noise.
    """
    if not (likeliest.varies or state.problem.has_structure(fit)):
        return EVIDENCE_SCALE
    base = state.evaluations.refit_without(effect).joint
    return evidence_scale(fit.joint.log_marginal - base.log_marginal)


def _unmodelled(state: SearchState, effect: Effect) -> dict[str, float]:
    """Return what may differ from view to view in the place of an effect that does, and that no
    model can have: the names of the numbers, with their probabilities beside that of the effect.
    """
    if not effect.varies:
        return {}
    fitted, context = _without(state, effect)
    differing = Differing.of(fitted, context, nameless=False) if fitted.joint.finite else None
    if not differing:
        return {}
    chances = dict.fromkeys([effect.name], MIN_MEMBER_PROBABILITY)
    for variation, chance in zip(differing.variations, differing.probabilities, strict=True):
        name = variation.group.name
        if name == effect.name or not (variation.effects(context) or not variation.group.has_cause):
            chances[name] = chance
    total = sum(chances.values())
    return {
        name: chance / total
        for name, chance in chances.items()
        if name != effect.name and chance / total > 1 - NAME_ALONE
    }


def _without(state: SearchState, effect: Effect) -> tuple[FittedModel, EffectContext]:
    """Return the fit without an effect, and its context."""
    base = state.evaluations.refit_without(effect)
    problem = state.problem
    fitted = FittedModel(base.model, problem.observations, base.joint)
    return fitted, effect_context(fitted, problem.board, problem.camera, locate=False)


def _replace_effect(state: SearchState, rival: Rival) -> SearchState:
    """Return the state with the rival in the model, and its trial."""
    half = rival.fit.model.path.has_private_blocks
    base_errors = state.evaluations.held_out_errors_with(rival.base.effects, half=half)
    state = state.with_fit(rival.fit)
    gain = held_out_gain(base_errors, state.evaluations.held_out_errors(half=half))
    return state.with_trial(Trial(rival.test, rival.fit, gain=gain))


def _odds(fit: ModelFit, best: ModelFit, observations: Observations, scale: float) -> float:
    """Return the odds of a fit against the most probable one: those of their marginal likelihoods
    or, if these are less decisive, those of Vuong's test, which does not assume a true model. How
    large the views' own numbers are does not decide there: they take up what either model lacks.

    Args:
        scale: a difference of this much in log evidence counts as 1.
    """
    if fit is best:
        return 1.0
    difference = best.joint.log_marginal - fit.joint.log_marginal
    decided = difference
    if best.model.path.view_blocks == fit.model.path.view_blocks:
        decided = min(difference, max(0.0, difference - prior_difference(best, fit)))
    p_value = float(ndtr(-vuong_statistic(best, fit, decided, observations)))
    return max(float(np.exp(-difference / scale)), p_value / (1 - p_value))


def _rivals(state: SearchState, effect: Effect) -> list[Rival]:
    """Return the other effects that do much of what an effect does, fitted in its place.

    Effects without a cause are no rivals, nor are parameters of single views that are not what
    differs. What may differ as probably as what does is a rival, whatever it can do: the score of
    an effect with parameters in every view has a part that follows noise. Numbers that follow a
    pattern have all other numbers as rivals that may follow it: the fit decides, as large changes
    are not linear.
    """
    base = state.evaluations.refit_without(effect)
    problem = state.problem
    if not base.joint.finite:
        return []
    fitted, context = _without(state, effect)
    present = {e.name for e in state.model.effects}
    # Numbers of single views can imitate what the model lacks, also where they get no name.
    gain = state.joint.log_marginal - base.joint.log_marginal
    differing = _rival_variations(effect, gain, fitted, context)
    varying = [
        rival
        for variation in (differing.variations if differing else ())
        for rival in variation.effects(context)
    ]
    likely = {item.group.name for item in (differing.likely if differing and effect.varies else ())}
    if isinstance(effect, Varying):
        names = {rival.name for rival in varying}
        varying += [
            replace(effect, name=group.name, numbers=group.number_names)
            for group in groups_of(context)
            if group.may_vary(effect.varies) and group.name not in names
        ]
    test = score_test(fitted, effect)
    shift = _corner_shift(test, state.joint)
    shared = [
        proposal
        for kind in KINDS
        if kind.has_cause and not kind.per_view
        for proposal in kind.propose(context)
    ]
    proposals = [rival for rival in (*shared, *varying) if rival.name not in present]
    rivals = []
    for candidate in tuned_score_tests(fitted, proposals):
        if shift.size and candidate.jacobian.size:
            overlap = float(((candidate.span().T @ shift) ** 2).sum() / (shift @ shift))
        else:
            overlap = candidate.chi2 / test.chi2
        is_hopeless = (candidate.effect.name, candidate.effect.form) in state.hopeless
        is_likely = bool(candidate.effect.varies) and candidate.effect.name in likely
        if (overlap < MIN_OVERLAP and not is_likely) or is_hopeless:
            continue
        if (rough := _competitive_fit(state, base, candidate.effect)) is None:
            continue
        model, joint = with_most_probable(base.model, candidate.effect, problem.observations, rough)
        # A smaller evidence means that the fit did not converge, or that the effect does nothing.
        probable = joint.finite and joint.log_marginal > base.joint.log_marginal
        if probable and not is_impossible(candidate.effect, joint):
            candidate = replace(candidate, effect=model.effects[-1])
            rivals.append(Rival(candidate, base.model, ModelFit(model, joint)))
    return rivals


def _rival_variations(
    effect: Effect, gain: float, fitted: FittedModel, context: EffectContext
) -> Differing | None:
    """Return what may differ from view to view in the place of an effect.

    Args:
        gain: the increase of the log evidence by the effect.
        fitted: the fit without the effect.
        context: its context.
    """
    if not effect.varies and largest_gain(fitted, context) < HOPELESS_PART * gain:
        return None
    return Differing.of(fitted, context, nameless=False)


def _competitive_fit(state: SearchState, base: ModelFit, effect: Effect) -> JointFit | None:
    """Return a rough fit with another effect; None if a better fit cannot make it competitive."""
    observations = state.problem.observations
    model = base.model.with_effect(effect)
    joint = rough_fit(model, observations, base.joint)
    if not joint.finite:
        return None
    difference = state.joint.log_marginal - joint.log_marginal
    statistic = vuong_statistic(state.fit, ModelFit(model, joint), difference, observations)
    return None if statistic > HOPELESS_STATISTIC else joint


def _corner_shift(test: ScoreTest, joint: JointFit) -> NDArray[np.float64]:
    """Return (2M,) the shifts of the corners by a fitted effect, over sigma, that other parameters
    cannot do; (0,) for parameters of single views.
    """
    if not test.jacobian.size:
        return np.zeros(0)
    vector = [
        (joint.values[u.param.name].numpy().ravel() - u.neutral) / u.param.scale
        for u in test.effect.effect_parameters
    ]
    return np.asarray(test.jacobian @ np.concatenate(vector))
