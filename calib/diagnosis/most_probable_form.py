"""Of the forms of an effect that differ in how many parameters they have, the one that a fit's evidence chooses."""

from __future__ import annotations

from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.observations import Observations


def with_most_probable(
    model: CameraModel, effect: Effect, observations: Observations, without: JointFit, begin: JointFit | None = None
) -> tuple[CameraModel, JointFit]:
    """The model with the effect, in the most probable of its forms, and the fit; noise and prior are estimated anew. What single views
    have for themselves is as large as it may be while the corners are more probable with it than without: a narrower prior may be more
    probable still, but what another view has beyond it is then missed.

    Args:
        without: of the model as it is.
        begin: with the effect, where the fits start; None: where `without` ended.
    """
    start = begin or without

    def fitted(form: Effect) -> tuple[CameraModel, JointFit]:
        wider = model.with_effect(form)
        return wider, wider.fitted(observations, start.poses, start.start, ROUNDS)

    forms = effect.alternatives() or (effect,)
    if not effect.per_view:
        return max(map(fitted, forms), key=lambda fit: fit[1].log_evidence)
    tried = []
    for form in reversed(forms):
        tried.append(fitted(form))
        if tried[-1][1].log_marginal > without.log_marginal:
            return tried[-1]
    return max(tried, key=lambda fit: fit[1].log_marginal)
