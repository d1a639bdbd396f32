"""The most probable form of an effect, among forms with different numbers of parameters.

A form with fewer parameters is the largest form with the other parameters at their neutral values.
So one fit gives the evidence of all forms, by the Savage-Dickey ratio.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.objective import view_precision
from calib.estimation.observations import Observations
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import LaplaceEvidence
from calib.inference.savage_dickey import savage_dickey_log_odds
from calib.inference.warm_start import start_with_effect, start_without_effects


def with_most_probable(
    model: CameraModel, effect: Effect, observations: Observations, start: JointFit
) -> tuple[CameraModel, JointFit]:
    """Return the model with the effect in its most probable form, and its fit with noise and prior
    estimated again.

    Args:
        start: a fit of the model with or without the effect, from which the fits start.
    """
    forms = [model.with_effect(form) for form in effect.alternatives() or (effect,)]
    if effect.per_view:
        return _fit_most_probable_size(forms, observations, start)
    largest = forms[-1]
    moved = start_with_effect(largest, observations, start)
    joint = largest.fit(observations, moved.poses, moved.start, ROUNDS)
    if not joint.finite:
        return largest, joint
    best = forms[int(np.argmax([savage_dickey_log_odds(form, largest, joint) for form in forms]))]
    if best is largest:
        return largest, joint
    best_start = start_without_effects(best, largest, joint, observations)
    return best, best.fit(observations, joint.poses, best_start, ROUNDS)


def _fit_most_probable_size(
    forms: Sequence[CameraModel], observations: Observations, start: JointFit
) -> tuple[CameraModel, JointFit]:
    """Return the most probable of models that differ in the prior size of per-view parameters.

    The evidence at every other size is known around one fit, so the search moves from size to size
    until it stays.
    """
    fits = dict[int, JointFit]()
    joint = start

    def most_probable(index: int) -> int:
        evidence = LaplaceEvidence.of(FittedModel(forms[index], observations, joint))
        return int(
            np.argmax(
                [evidence.max_log_evidence(view_precision(f.path, joint.poses)) for f in forms]
            )
        )

    middle = len(forms) // 2
    is_fit_of_forms = start.poses.shape == forms[middle].pad_poses(start.poses).shape
    index = most_probable(middle) if is_fit_of_forms else middle
    while index not in fits:
        joint = forms[index].fit(observations, joint.poses, joint.start, ROUNDS)
        fits[index] = joint
        if not joint.finite:
            break
        index = most_probable(index)
    best = max(fits, key=lambda index: fits[index].log_marginal)
    return forms[best], fits[best]
