"""Effects in simpler forms than they were found in: what another one that came later took over,
they need no more.
"""

from __future__ import annotations

from calib.diagnosis.most_probable_form import odds_of
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS
from calib.estimation.observations import Observations
from calib.inference.score_test import ModelFit
from calib.inference.warm_start import start_of_fewer


def simplified(fit: ModelFit, base: CameraModel, observations: Observations) -> ModelFit:
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
                form for form in effect.alternatives() if len(form.unknowns) < len(effect.unknowns)
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
        joint = fewer.fitted(observations, fit.joint.poses, start, ROUNDS)
        if joint.finite and joint.log_marginal > fit.joint.log_marginal:
            fit = ModelFit(fewer, joint)
    return fit
