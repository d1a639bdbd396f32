"""A model of the camera as a fit sees it: the ray path, the priors of its parameters, and the
effects that were added.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from torch import Tensor

from calib.effects.effect import Effect, is_possible
from calib.estimation.joint_fit import AGAIN, ROUNDS, JointFit, Start, fit_joint
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refine_poses_in_image
from calib.estimation.priors import Priors
from calib.optics.board_target import with_blocks
from calib.optics.params import Values
from calib.optics.path import Path

CLOSE = 1e-6
"""The fraction of its error by which a held-out view's last step may still lower it."""


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A ray path with priors."""

    path: Path
    means: Values
    """Every value of the path: where it is held, or its prior's mean."""
    priors: Priors
    """Of what is estimated beside the relief."""
    effects: tuple[Effect, ...] = ()

    @property
    def parameters(self) -> Parameters:
        """What a fit of it estimates, beside the views' own parameters."""
        return Parameters.of(self.path, self.means, self.priors)

    def with_effect(self, effect: Effect) -> CameraModel:
        """The model with one effect more, at the start of its parameters."""
        values = {
            u.param.name: torch.full(u.param.shape, u.initial, dtype=torch.float64)
            for u in effect.effect_parameters
        }
        sigmas = {u.param.name: u.sigma for u in effect.effect_parameters}
        return CameraModel(
            effect.apply(self.path),
            {**self.means, **values},
            self.priors.beside(sigmas),
            (*self.effects, effect),
        )

    def with_effects(self, effects: Iterable[Effect]) -> CameraModel:
        """The model with some effects more, but for those on a cover that is not there: a window
        that was found may be dropped.
        """
        return reduce(
            lambda model, effect: (
                model.with_effect(effect) if is_possible(effect, model.path) else model
            ),
            effects,
            self,
        )

    def neutral(self, effect: Effect) -> Values:
        """The parameters of an effect where it is not there."""
        return {
            u.param.name: torch.full(u.param.shape, u.neutral, dtype=torch.float64)
            for u in effect.effect_parameters
        }

    def fitted(
        self,
        observations: Observations,
        poses: Tensor,
        start: Start | None = None,
        rounds: Sequence[float] | None = None,
    ) -> JointFit:
        """The most probable parameters, from a start like `fit_joint`'s; those that the start lacks
        begin at their means.

        Args:
            rounds: of `fit_joint`; None: what a fit takes that has such a start, or none.
        """
        if start:
            start = replace(
                start,
                values={name: start.values.get(name, mean) for name, mean in self.means.items()},
            )
        rounds = rounds or (AGAIN if start else ROUNDS)
        return fit_joint(
            self.path,
            self.means,
            observations,
            self.padded(poses),
            priors=self.priors,
            start=start,
            rounds=rounds,
        )

    def padded(self, poses: Tensor) -> Tensor:
        """(V, B) parameters of views as this model has them: what is new to it is zero, and what it
        has not is dropped.
        """
        return with_blocks(poses, self.path.view_blocks)

    def seen(self, joint: JointFit, observations: Observations, poses: Tensor) -> Tensor:
        """The (V, B) own parameters of views that were not fitted, from a start."""
        padded = self.padded(poses)
        return refine_poses_in_image(
            self.path, joint.values, observations, padded, sigma=joint.sigma, tolerance=CLOSE
        ).blocks
