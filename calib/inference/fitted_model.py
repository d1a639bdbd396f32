"""A model at the optimum of its fit, and the linear equations of its views there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.corner_cells import average_corners
from calib.estimation.joint_fit import Estimate, JointFit
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import pixel_weights
from calib.estimation.view_equations import ViewEquations, information, view_equations

Array = NDArray[np.float64]

MAX_VIEWS = 500
"""The largest number of views of which it is asked how numbers differ from view to view."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelFit:
    """A model and its fit to all views."""

    model: CameraModel
    joint: JointFit


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model at the optimum of its fit, with the observations."""

    model: CameraModel
    observations: Observations
    joint: Estimate

    @property
    def merged_squares(self) -> float:
        """The squares of errors about averages of corners, over the noise variance."""
        return self.observations.merged_squares / self.joint.sigma**2

    def averaged(self, image: Tensor | None = None) -> FittedModel:
        """Return the same fit with averages of neighbouring corners, of a session with very many
        (`average_corners`): for questions, which sum over corners whatever is smooth over a board.

        Args:
            image: (M, 2) px, the reprojection errors, if they are known.
        """
        averages = average_corners(
            self.model.path,
            self.joint.values,
            self.observations,
            self.joint.poses,
            self.joint.sigma,
            image,
        )
        return replace(self, observations=averages)

    def some_views(self) -> FittedModel:
        """Return the same fit with at most MAX_VIEWS of the views, spread evenly: for questions of
        how numbers differ from view to view, whose time grows faster than their number.
        """
        count = len(self.observations.names)
        if count <= MAX_VIEWS:
            return self
        chosen = torch.zeros(count, dtype=torch.bool)
        chosen[torch.linspace(0, count - 1, MAX_VIEWS).round().long()] = True
        joint = replace(self.joint, poses=self.joint.poses[chosen])
        return FittedModel(self.model, self.observations.without_views(~chosen), joint)

    @property
    def deviation(self) -> Array:
        """(S,) the vector of the fitted parameters minus their prior mean."""
        return np.asarray(self.model.parameters.vector(self.joint.values).numpy())

    def with_neutral(self, effects: Sequence[Effect]) -> FittedModel:
        """Return the same fit with further effects at their neutral values, whose priors count."""
        model = self.model.with_effects(effects)
        neutral = {
            name: value
            for effect in effects
            for name, value in model.neutral_values(effect).items()
        }
        joint = replace(self.joint, values={**self.joint.values, **neutral})
        return FittedModel(model, self.observations, joint)

    def parameters(self, effects: Sequence[Effect] = ()) -> Parameters:
        """Return the fitted parameters at the optimum, followed by those of further effects at
        their neutral values.
        """
        extended = self.with_neutral(effects)
        model = extended.model
        names = [number.param.name for effect in effects for number in effect.effect_parameters]
        return Parameters.of(model.path, extended.joint.values, model.priors, last=names)

    def equations(self, effects: Sequence[Effect] = ()) -> Iterator[ViewEquations]:
        """Yield the linearised equations of each view in `parameters(effects)`."""
        model = self.model.with_effects(effects)
        return view_equations(
            model.path,
            self.parameters(effects),
            self.observations,
            model.pad_poses(self.joint.poses),
            self.joint.sigma,
            self.weights,
        )

    @cached_property
    def weights(self) -> Tensor:
        """The (M, 2, 2) weights of the corners (`pixel_weights`). Neutral effects change none."""
        return pixel_weights(
            self.model.path,
            self.joint.values,
            self.observations,
            self.joint.poses,
            self.joint.sigma,
        )

    def information(self, effects: Sequence[Effect] = ()) -> Array:
        """Return (V, S, S), the information of each view on `parameters(effects)`, with the view's
        own parameters eliminated.
        """
        return information(self.equations(effects), self.parameters(effects).count)

    def prior_precision(self, effects: Sequence[Effect] = ()) -> Array:
        """Return the (S, S) prior precision of `parameters(effects)`."""
        return self.parameters(effects).prior_precision(self.joint.smoothness)

    @property
    def freedom(self) -> int:
        """The number of residuals minus that of the views' own parameters."""
        return self.observations.residual_count - self.joint.poses.numel()
