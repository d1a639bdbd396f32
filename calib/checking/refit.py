"""A fit of the checked views with the calibration as its prior, with or without a change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from torch import Tensor

from calib.checking.posterior_predictive import parameters_with_changes, prior_spread
from calib.checking.prior import CalibrationPrior
from calib.effects.effect import Effect
from calib.estimation.covariance import invert_precision
from calib.estimation.levenberg_marquardt import Outcome, minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import Residuals, reach_board, residuals
from calib.optics.path import Path

Array = NDArray[np.float64]

TOLERANCE = 1e-5
ROUGH_TOLERANCE = 1e-3
"""The tolerance for a change alone; its fit is linearised again afterwards."""
MAX_STEPS = 40


@dataclass(frozen=True, slots=True, eq=False)
class Refit:
    """The result of a refit."""

    path: Path
    parameters: Parameters
    """The estimated parameters: the calibrated ones, then those of the change."""
    shared: Tensor
    """(S,) their deviations from the calibration and from no change, over their scales."""
    poses: Tensor
    covariance: Array
    """(S, S); NaN where the fit failed."""
    outcome: Outcome
    iterations: int

    @property
    def values(self) -> dict[str, Tensor]:
        return self.parameters.values(self.shared)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.covariance).all())

    def residuals(self, observations: Observations) -> Residuals:
        """Return the residuals of the fit."""
        return residuals(self.path, self.values, observations, self.poses)


def refit(
    prior: CalibrationPrior,
    change: Effect | None,
    observations: Observations,
    poses: Tensor,
    sigma: float,
    *,
    start: dict[str, Tensor] | None = None,
    change_only: bool = False,
) -> Refit:
    """Return the most probable parameters.

    Args:
        poses: (V, B) initial poses.
        sigma: the noise of a corner, px per axis.
        start: initial values that differ from the calibration's.
        change_only: True to hold the calibrated parameters and fit the change alone.
    """
    changes = [change] if change else []
    parameters, new = parameters_with_changes(prior, changes)
    path = prior.model.with_effects(new).path
    if change_only and change:
        parameters = Parameters(
            parameters.origin,
            None,
            tuple(u.param for u in change.effect_parameters),
            parameters.priors,
        )
        precision = torch.from_numpy(np.diag(prior_spread(change) ** -2.0))
    else:
        precision = torch.from_numpy(_precision(prior, parameters, change, new))
    shared = parameters.vector({**parameters.origin, **(start or {})})
    initial = parameters.values(shared)
    visible_observations = observations.select_rows(reach_board(path, initial, observations, poses))
    weights = pixel_weights(path, initial, visible_observations, poses, sigma)
    problem = LandingProblem(
        parameters,
        tuple(make_residual_blocks(path, parameters, visible_observations, weights, initial)),
        precision,
        view_precision(path, poses),
    )
    solution = minimise(
        problem,
        shared,
        poses,
        steps=MAX_STEPS,
        tolerance=ROUGH_TOLERANCE if change_only else TOLERANCE,
    )
    hessian = solution.equations.eliminate_blocks().hessian
    covariance = invert_precision(hessian + precision).numpy()
    if solution.outcome is Outcome.NOT_FINITE:
        covariance = np.full_like(covariance, np.nan)
    return Refit(
        path=path,
        parameters=parameters,
        shared=solution.shared,
        poses=solution.blocks,
        covariance=covariance,
        outcome=solution.outcome,
        iterations=solution.iterations,
    )


def _precision(
    prior: CalibrationPrior, parameters: Parameters, change: Effect | None, new: list[Effect]
) -> Array:
    """Return the (S, S) prior precision: the calibration's covariance, widened by the change."""
    covariance = prior.root @ prior.root.T
    if change and change in new:
        covariance = block_diag(covariance, np.diag(prior_spread(change) ** 2))
    elif change:
        entries = parameters.entries(u.param.name for u in change.effect_parameters)
        covariance = covariance.copy()
        covariance[entries, entries] += prior_spread(change) ** 2
    return invert_precision(torch.from_numpy(covariance)).numpy()
