"""Find the numbers, such as the focal length, that differ from view to view.

A number counts only if it explains more than a smooth error of each view's own, for which there is
no cause: the *discrepancy* of the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from calib.effects.effect import Effect, EffectContext
from calib.effects.registry import OF_VIEW
from calib.inference.fitted_model import FittedModel
from calib.inference.model_discrepancy import possible_gain
from calib.inference.score_test import tuned_score_tests
from calib.inference.variation import Variation
from calib.inference.variation_equations import VariationEquations
from calib.inference.variation_rows import VariationRows
from calib.inference.varying_numbers import (
    STRUCTURE,
    Group,
    VariationKind,
    groups_of,
    patterns_of,
)

MAX_DEVIATION = 3.0
"""Tolerances, root mean square: numbers that differ by more are not possible."""
MAX_REFINED = 4
"""The number of the best variations beside which the discrepancy is estimated again."""
MIN_GAIN = 7.0
"""The smallest gain in log evidence that is reported: some sixty variations are tried."""
MIN_EXPLAINED = 0.75
"""The part of the log evidence of the discrepancy that numbers must explain alone to have a name. A
motion explains at most 0.64 of a vibration of each view's own.
"""
MIN_VIEWS = 8
"""With fewer views, nothing is tested."""


def find_variations(
    fitted: FittedModel,
    context: EffectContext,
    shared: Sequence[type[Effect]] = (),
    *,
    nameless: bool = True,
    about: Group | None = None,
) -> list[Variation]:
    """Return what differs from view to view, the most probable first.

    If a model lacks something in single views, any numbers of single views imitate it. So a
    variation must pass two tests:

    - Its gain in log evidence over a model with a discrepancy (calib.inference.model_discrepancy)
      exceeds MIN_GAIN. The discrepancy is estimated again with the variation in the model.
    - By itself, it explains most of what the discrepancy by itself explains (MIN_EXPLAINED). The
      discrepancy is smooth, and what the model lacks may not be: numbers that follow a part of it
      pass the first test.

    If variations pass the first test and none the second one, what differs has no name, and the
    result is a `nameless_variation`.

    Args:
        fitted: a model at its optimum.
        shared: kinds of effects that all views share, which explain what they can where the model
            lacks them.
        nameless: allow for a discrepancy. Without it, numbers that imitate what the model lacks are
            returned too.
        about: the only group of which it matters whether its numbers differ. Nothing is returned if
            it explains too little by itself to have a name, which takes a third of the time.
    """
    if not _may_differ(fitted, context):
        return []
    patterns = patterns_of(fitted)
    groups = [g for g in _groups(fitted, context) if nameless or g.has_cause]
    rows = VariationRows.of(_with_shared_effects(fitted, context, shared), context)
    plain = VariationEquations.of(rows)
    with_discrepancy = VariationEquations.of(rows, rows.discrepancy(plain.solution))
    discrepancy_gain = with_discrepancy.log_evidence - plain.log_evidence
    baseline = plain.log_evidence + possible_gain(discrepancy_gain)
    min_gain_of_name = MIN_EXPLAINED * max(0.0, discrepancy_gain)
    if about:
        gains = [variation.gain for variation in plain.group(about).variations(patterns)]
        if max(gains) <= min_gain_of_name:
            return []
    pairs = sorted(
        zip(
            plain.variations(groups, patterns),
            with_discrepancy.variations(groups, patterns),
            strict=True,
        ),
        key=lambda pair: -pair[0].gain,
    )
    # Numbers of these groups explain most of what the discrepancy explains, so they have a name.
    named_groups = {v.group.name for v, _ in pairs if v.gain > min_gain_of_name}
    gains = []
    results = []
    for index, (variation, variation_with_discrepancy) in enumerate(pairs):
        if variation.largest >= MAX_DEVIATION:
            continue
        with_both = with_discrepancy.log_evidence + variation_with_discrepancy.gain
        if index < MAX_REFINED and variation.gain > MIN_GAIN:
            with_both = max(with_both, plain.log_evidence_beside(variation))
        with_variation = plain.log_evidence + variation.gain
        gain = with_variation + possible_gain(with_both - with_variation) - baseline
        if gain <= MIN_GAIN:
            continue
        gains.append(gain)
        if variation.group.name in named_groups or not nameless:
            likelihoods = (
                with_discrepancy.view_log_likelihoods(variation_with_discrepancy)
                if discrepancy_gain > 0
                else plain.view_log_likelihoods(variation)
            )
            results.append(replace(variation, gain=gain, view_log_likelihoods=likelihoods))
    if gains and not results:
        return [nameless_variation(max(gains), len(fitted.observations.names))]
    return sorted(results, key=lambda variation: -variation.gain)


def _with_shared_effects(
    fitted: FittedModel, context: EffectContext, kinds: Sequence[type[Effect]]
) -> FittedModel:
    """Return a model with the effects of these kinds that it lacks, at their neutral values, and
    with priors adapted to the residual.
    """
    present = {effect.name for effect in fitted.model.effects}
    proposals = [
        effect for kind in kinds if kind.name not in present for effect in kind.propose(context)
    ]
    return fitted.with_neutral([test.effect for test in tuned_score_tests(fitted, proposals)])


def nameless_variation(gain: float, views: int) -> Variation:
    """Return a variation without numbers, for views that differ in a way that no number explains: a
    discrepancy in each of them.
    """
    deviations = np.zeros((views, 0))
    group = Group(STRUCTURE, (), (VariationKind.EACH,))
    return Variation(group, VariationKind.EACH, gain, np.zeros(0), deviations, np.zeros(0))


def largest_gain(fitted: FittedModel, context: EffectContext) -> float:
    """Return the largest increase of the log evidence by numbers that differ from view to view,
    over the model as it is; 0 for few views.
    """
    if len(fitted.observations.names) < MIN_VIEWS:
        return 0.0
    return _with_largest_gain(fitted, context)[1]


def largest_log_evidence(fitted: FittedModel, context: EffectContext) -> float:
    """Return the log evidence of a model, with its noise chosen again, beside the numbers that
    differ from view to view most probably. It compares models of the same views and of the same
    parameters of views, fitted with the same noise.
    """
    equations, gain = _with_largest_gain(fitted, context)
    return equations.log_evidence + max(0.0, gain)


def log_evidence_beside_discrepancy(fitted: FittedModel, context: EffectContext) -> float:
    """Return the log evidence of a model in px, with its noise chosen again, beside the most
    probable discrepancy. It compares models of the same views and of the same parameters of views.
    """
    rows = VariationRows.of(fitted, context)
    discrepancy = rows.discrepancy(VariationEquations.of(rows).solution)
    evidence = VariationEquations.of(rows, discrepancy).log_evidence
    return evidence - sum(len(view) for view in rows.views) * float(np.log(fitted.joint.sigma))


def _may_differ(fitted: FittedModel, context: EffectContext) -> bool:
    """Return True if numbers that differ from view to view make the views more probable."""
    if len(fitted.observations.names) < MIN_VIEWS:
        return False
    return any(variation.gain >= MIN_GAIN for variation in _variations(fitted, context)[1])


def _with_largest_gain(
    fitted: FittedModel, context: EffectContext
) -> tuple[VariationEquations, float]:
    """Return the equations of a model as it is, and the largest gain of its variations."""
    equations, variations = _variations(fitted, context)
    return equations, max((variation.gain for variation in variations), default=0.0)


def _variations(
    fitted: FittedModel, context: EffectContext
) -> tuple[VariationEquations, Iterator[Variation]]:
    """Return the equations of a model as it is, and its variations, each computed when it is
    reached.
    """
    equations = VariationEquations.of(VariationRows.of(fitted, context))
    return equations, equations.variations(_groups(fitted, context), patterns_of(fitted))


def _groups(fitted: FittedModel, context: EffectContext) -> list[Group]:
    """Return the groups of numbers of which the model does not say yet that they differ. Views
    cannot have both a focal length and a principal point of their own.
    """
    varying = {effect.name for effect in fitted.model.effects if effect.varies}
    groups = [group for group in groups_of(context) if group.name not in varying]
    if context.path.camera_block:
        of_view = {kind.name for kind in OF_VIEW}
        groups = [group.without_each() if group.name in of_view else group for group in groups]
    return groups
