"""Effects in simpler forms than they were found in: what another one that came later took over,
they need no more.
"""

from __future__ import annotations

from calib.diagnosis.most_probable_form import odds_of
from calib.diagnosis.near_start import start_of_fewer
from calib.diagnosis.trial import Fit
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS
from calib.estimation.observations import Observations


def simplified(fit: Fit, base: CameraModel, observations: Observations) -> Fit:
    """The same fit, or one in which effects that all views share have fewer parameters and the
    corners are more probable.

    Args:
        base: the model without any effect.
    """
    for place, effect in enumerate(fit.model.effects):
        forms = (
            []
            if effect.per_view
            else [
                form
                for form in effect.alternatives()
                if len(form.effect_parameters) < len(effect.effect_parameters)
            ]
        )
        effects = fit.model.effects
        models = [
            base.with_effects([*effects[:place], form, *effects[place + 1 :]]) for form in forms
        ]
        odds = [odds_of(model, fit.model, fit.joint) for model in models]
        if not odds or max(odds) <= 0:
            continue
        fewer = models[odds.index(max(odds))]
        start = start_of_fewer(fewer, fit.model, fit.joint, observations)
        joint = fewer.fit(observations, fit.joint.poses, start, ROUNDS)
        if joint.finite and joint.log_marginal > fit.joint.log_marginal:
            fit = Fit(fewer, joint)
    return fit
