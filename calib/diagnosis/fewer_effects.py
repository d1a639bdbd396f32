"""A model with some of its effects alone: what the others do, and whether they are needed, is asked
of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from calib.diagnosis.near_start import start_of_fewer
from calib.diagnosis.trial import Fit
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations


@dataclass(slots=True, eq=False)
class FewerEffects:
    """Each is fitted once."""

    base: CameraModel
    """Without any effect."""
    observations: Observations
    known: dict[tuple[str, ...], Fit] = field(default_factory=dict)
    """Of the model as it is, by the effects that stay."""
    earlier: dict[tuple[str, ...], JointFit] = field(default_factory=dict)
    """Where the models that the loop went through ended, by their effects."""

    def fitted(self, whole: Fit, effects: Sequence[Effect]) -> Fit:
        """With the noise and the prior of the whole model; from where the loop had it once, or from
        where the whole ended.
        """
        if len(effects) == len(whole.model.effects):
            return whole
        names = _names(effects)
        if names not in self.known:
            model, poses, start = (
                self.base.with_effects(effects),
                whole.joint.poses,
                whole.joint.start,
            )
            if was := self.earlier.get(names):
                poses, start = was.poses, replace(start, values=was.values)
            else:
                start = start_of_fewer(model, whole.model, whole.joint, self.observations)
            self.known[names] = Fit(model, model.fit(self.observations, poses, start))
        return self.known[names]

    def passed(self, whole: Fit) -> None:
        """The loop has had this model."""
        self.earlier[_names(whole.model.effects)] = whole.joint

    def forget(self) -> None:
        """The model is another one."""
        self.known.clear()


def _names(effects: Sequence[Effect]) -> tuple[str, ...]:
    return tuple(effect.name for effect in effects)
