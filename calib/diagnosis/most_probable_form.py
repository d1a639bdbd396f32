"""Of the forms of an effect that differ in how many parameters they have, the one that a fit's evidence chooses."""

from __future__ import annotations

from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.observations import Observations


def with_most_probable(model: CameraModel, effect: Effect, observations: Observations, begin: JointFit) -> tuple[CameraModel, JointFit]:
    """The model with the effect, in the most probable of its forms, and the fit; noise and prior are estimated anew.

    Args:
        begin: of the model, with the effect or without: where the fits start.
    """
    forms = [model.with_effect(form) for form in effect.alternatives() or (effect,)]
    fits = [(form, form.fitted(observations, begin.poses, begin.start, ROUNDS)) for form in forms]
    return max(fits, key=lambda fit: fit[1].log_marginal if effect.per_view else fit[1].log_evidence)
