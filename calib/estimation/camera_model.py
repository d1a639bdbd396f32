"""The camera model that a fit works with: the ray path, the priors of its parameters, and the added
effects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from torch import Tensor

from calib.effects.effect import Effect, is_possible
from calib.estimation.joint_fit import ROUNDS, WARM_ROUNDS, Estimate, JointFit, Start, fit_joint
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refine_poses_in_image
from calib.estimation.priors import Priors
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.view_blocks import with_blocks

POSE_TOLERANCE = 1e-6
"""The pose of a held-out view has converged when a step lowers its error by less than this
fraction.
"""


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A ray path with priors."""

    path: Path
    means: Values
    """Every value of the path: the mean of its prior, or the constant at which it is held."""
    priors: Priors
    """The priors of the estimated parameters; the relief's is separate."""
    effects: tuple[Effect, ...] = ()

    @property
    def parameters(self) -> Parameters:
        """The shared parameters that a fit of this model estimates."""
        return Parameters.of(self.path, self.means, self.priors)

    def with_effect(self, effect: Effect) -> CameraModel:
        """Return the model with one more effect, at the start of its parameters."""
        values = {
            u.param.name: torch.full(u.param.shape, u.initial, dtype=torch.float64)
            for u in effect.effect_parameters
        }
        sigmas = {u.param.name: u.sigma for u in effect.effect_parameters}
        return CameraModel(
            effect.apply(self.path),
            {**self.means, **values},
            self.priors.with_sigmas(sigmas),
            (*self.effects, effect),
        )

    def with_effects(self, effects: Iterable[Effect]) -> CameraModel:
        """Return the model with more effects. An effect on a cover that the path lacks is left out:
        a window that an effect added may have been dropped.
        """
        return reduce(
            lambda model, effect: (
                model.with_effect(effect) if is_possible(effect, model.path) else model
            ),
            effects,
            self,
        )

    def neutral_values(self, effect: Effect) -> Values:
        """Return the parameters of an effect at which it does nothing."""
        return {
            u.param.name: torch.full(u.param.shape, u.neutral, dtype=torch.float64)
            for u in effect.effect_parameters
        }

    def fit(
        self,
        observations: Observations,
        poses: Tensor,
        start: Start | None = None,
        rounds: Sequence[float] | None = None,
        progress: Callable[[int, float], None] | None = None,
    ) -> JointFit:
        """Fit the most probable parameters, from a start like that of `fit_joint`; parameters that
        the start lacks start at their means.

        Args:
            rounds: as in `fit_joint`; None means WARM_ROUNDS with a start, else ROUNDS.
            progress: as in `fit_joint`.
        """
        if start:
            start = replace(
                start,
                values={name: start.values.get(name, mean) for name, mean in self.means.items()},
            )
        rounds = rounds or (WARM_ROUNDS if start else ROUNDS)
        return fit_joint(
            self.path,
            self.means,
            observations,
            self.pad_poses(poses),
            priors=self.priors,
            start=start,
            rounds=rounds,
            progress=progress,
        )

    def pad_poses(self, poses: Tensor) -> Tensor:
        """Return the (V, B) view parameters with the blocks of this model: a block that is new is
        zero, and a block that the model lacks is dropped.
        """
        return with_blocks(poses, self.path.view_blocks)

    def fit_poses(self, joint: Estimate, observations: Observations, poses: Tensor) -> Tensor:
        """Fit the (V, B) parameters of views that were not part of the joint fit, from a start."""
        pad_poses = self.pad_poses(poses)
        return refine_poses_in_image(
            self.path,
            joint.values,
            observations,
            pad_poses,
            sigma=joint.sigma,
            tolerance=POSE_TOLERANCE,
        ).blocks
