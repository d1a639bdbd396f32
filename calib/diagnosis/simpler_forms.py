"""Simpler forms of effects: a later effect may have taken over some of their parameters."""

from __future__ import annotations

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS
from calib.estimation.observations import Observations
from calib.inference.fitted_model import ModelFit
from calib.inference.savage_dickey import savage_dickey_log_odds
from calib.inference.warm_start import start_without_effects


def simplified(fit: ModelFit, base: CameraModel, observations: Observations) -> ModelFit:
    """Return the fit, or one with a larger evidence in which shared effects have fewer parameters.

    Args:
        base: the model without effects.
    """
    for index, effect in enumerate(fit.model.effects):
        if effect.per_view:
            continue
        forms = [
            f
            for f in effect.alternatives()
            if len(f.effect_parameters) < len(effect.effect_parameters)
        ]
        effects = fit.model.effects
        models = [
            base.with_effects([*effects[:index], form, *effects[index + 1 :]]) for form in forms
        ]
        log_odds = [savage_dickey_log_odds(model, fit.model, fit.joint) for model in models]
        if not log_odds or max(log_odds) <= 0:
            continue
        model = models[log_odds.index(max(log_odds))]
        start = start_without_effects(model, fit.model, fit.joint, observations)
        joint = model.fit(observations, fit.joint.poses, start, ROUNDS)
        if joint.finite and joint.log_marginal > fit.joint.log_marginal:
            fit = ModelFit(model, joint)
    return fit
