"""Of the forms of an effect that differ in how many parameters they have, the one that a fit's
evidence chooses.

A form with fewer parameters is one with more whose others are nothing. So one fit says how probable
all of them are: by how probable nothing is for these others after the fit, over how probable it was
beforehand.

Source: J. M. Dickey, The weighted likelihood ratio, linear hypotheses on normal location parameters
    (1971).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.far_start import begun
from calib.diagnosis.linearised import Linearised
from calib.diagnosis.near_start import start_of_fewer
from calib.diagnosis.score_test import Optimum
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit, invert_precision
from calib.estimation.objective import view_precision
from calib.estimation.observations import Observations


def with_most_probable(
    model: CameraModel, effect: Effect, observations: Observations, begin: JointFit
) -> tuple[CameraModel, JointFit]:
    """The model with the effect, in the most probable of its forms, and the fit; noise and prior
    are estimated anew.

    Args:
        begin: of the model, with the effect or without: where the fits start.
    """
    forms = [model.with_effect(form) for form in effect.alternatives() or (effect,)]
    if effect.per_view:
        return _of_most_probable_size(forms, observations, begin)
    at = begun(forms[-1], observations, begin)
    joint = forms[-1].fit(observations, at.poses, at.start, ROUNDS)
    best = (
        int(np.argmax([odds_of(form, forms[-1], joint) for form in forms]))
        if joint.finite
        else len(forms) - 1
    )
    if forms[best] is forms[-1]:
        return forms[-1], joint
    start = start_of_fewer(forms[best], forms[-1], joint, observations)
    return forms[best], forms[best].fit(observations, joint.poses, start, ROUNDS)


def odds_of(form: CameraModel, most: CameraModel, joint: JointFit) -> float:
    """The logarithm of a form's probability over that of the one with the most parameters, which
    was fitted.
    """
    parameters, fewer = joint.parameters, {param.name for param in form.parameters.free}
    others = [param for param in parameters.free if param.name not in fewer]
    if not others:
        return 0.0
    entries = parameters.entries(param.name for param in others)
    nothing = parameters.vector(most.means)[entries]
    away = parameters.vector(joint.values)[entries] - nothing
    covariance = joint.covariance[entries][:, entries]
    spread = np.concatenate(
        [np.ravel(most.priors.sigmas[param.name]) / param.scale for param in others]
    )
    after = -float(away @ invert_precision(covariance) @ away + covariance.slogdet().logabsdet) / 2
    return float(after + np.log(spread).sum())


def _of_most_probable_size(
    forms: Sequence[CameraModel], observations: Observations, begin: JointFit
) -> tuple[CameraModel, JointFit]:
    """Of models that differ in how large what single views have for themselves may be. Around one
    fit the corners' probability at every other size is known without another, so that it goes from
    size to size until it stays.
    """
    fits = dict[int, JointFit]()
    middle, joint = len(forms) // 2, begin

    def likeliest(around: int) -> int:
        at = Linearised.around(Optimum(forms[around], observations, joint))
        return int(np.argmax([at.best(view_precision(form.path, joint.poses)) for form in forms]))

    fitted_so = begin.poses.shape == forms[middle].pad_poses(begin.poses).shape
    place = likeliest(middle) if fitted_so else middle
    while place not in fits:
        fits[place] = joint = forms[place].fit(observations, joint.poses, joint.start, ROUNDS)
        if not joint.finite:
            break
        place = likeliest(place)
    best = max(fits, key=lambda place: fits[place].log_marginal)
    return forms[best], fits[best]
