"""Of the forms of an effect that differ in how many parameters they have, the one that a fit's evidence chooses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.far_start import begun
from calib.diagnosis.linearised import Linearised
from calib.diagnosis.score_test import Optimum
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.objective import view_precision
from calib.estimation.observations import Observations


def with_most_probable(model: CameraModel, effect: Effect, observations: Observations, begin: JointFit) -> tuple[CameraModel, JointFit]:
    """The model with the effect, in the most probable of its forms, and the fit; noise and prior are estimated anew.

    Args:
        begin: of the model, with the effect or without: where the fits start.
    """
    forms = [model.with_effect(form) for form in effect.alternatives() or (effect,)]
    if effect.per_view:
        return _of_most_probable_size(forms, observations, begin)
    starts = [begun(form, observations, begin) for form in forms]
    fits = [(form, form.fitted(observations, at.poses, at.start, ROUNDS)) for form, at in zip(forms, starts, strict=True)]
    return max(fits, key=lambda fit: fit[1].log_evidence)


def _of_most_probable_size(forms: Sequence[CameraModel], observations: Observations, begin: JointFit) -> tuple[CameraModel, JointFit]:
    """Of models that differ in how large what single views have for themselves may be. Around one fit the corners' probability at every
    other size is known without another, so that it goes from size to size until it stays."""
    fits = dict[int, JointFit]()
    place = len(forms) // 2
    joint = begin
    while place not in fits:
        fits[place] = joint = forms[place].fitted(observations, joint.poses, joint.start, ROUNDS)
        if not joint.finite:
            break
        around = Linearised.around(Optimum(forms[place], observations, joint))
        place = int(np.argmax([around.best(view_precision(form.path, joint.poses)) for form in forms]))
    best = max(fits, key=lambda place: fits[place].log_marginal)
    return forms[best], fits[best]
