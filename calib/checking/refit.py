"""A fit of the checked views with what the calibration knows as its prior, with or without a
change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from torch import Tensor

from calib.checking.equations import spread_of, widened
from calib.checking.known import Known
from calib.effects.effect import Effect
from calib.estimation.joint_fit import invert_precision
from calib.estimation.levenberg_marquardt import Outcome, minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import Residuals, residuals
from calib.optics.path import Path

Array = NDArray[np.float64]

TOLERANCE = 1e-5
ROUGH = 1e-3
"""Of a change alone, around which all is linearised again."""
STEPS = 40


@dataclass(frozen=True, slots=True, eq=False)
class Refit:
    """Where such a fit ended."""

    path: Path
    parameters: Parameters
    """What was free: the known ones, then the change's."""
    shared: Tensor
    """(S,) deviations of them from the calibration and from no change."""
    poses: Tensor
    covariance: Array
    """(S, S); NaN where the fit failed."""
    cost: float
    """The corners' robust squares over those of sigma, and the priors'."""
    iterations: int

    @property
    def values(self) -> dict[str, Tensor]:
        return self.parameters.values(self.shared)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.covariance).all())

    def missed(self, observations: Observations) -> Residuals:
        return residuals(self.path, self.values, observations, self.poses)


def refit(
    known: Known,
    change: Effect | None,
    observations: Observations,
    poses: Tensor,
    sigma: float,
    *,
    begin: dict[str, Tensor] | None = None,
    held: bool = False,
) -> Refit:
    """The most probable parameters.

    Args:
        poses: (V, B) to start from.
        sigma: px per axis.
        begin: values to start from, where they are not the calibration's.
        held: what the calibration knows stays as it is: only the change is fitted.
    """
    changes = [change] if change else []
    parameters, new = widened(known, changes)
    path = known.model.with_effects(new).path
    if held and change:
        parameters = Parameters(
            parameters.origin,
            None,
            tuple(u.param for u in change.effect_parameters),
            parameters.priors,
        )
        precision = torch.from_numpy(np.diag(spread_of(change) ** -2.0))
    else:
        precision = torch.from_numpy(_precision(known, parameters, change, new))
    shared = parameters.vector({**parameters.origin, **(begin or {})})
    start = parameters.values(shared)
    lands = (
        path.land(observations.pixels, observations.with_times(start), poses[observations.view])[1]
        == 0
    )
    seen = observations.select_rows(lands)
    weights = pixel_weights(path, start, seen, poses, sigma)
    problem = LandingProblem(
        parameters,
        tuple(make_residual_blocks(path, parameters, seen, weights, start)),
        precision,
        view_precision(path, poses),
    )
    found = minimise(problem, shared, poses, steps=STEPS, tolerance=ROUGH if held else TOLERANCE)
    hessian, _ = found.equations.schur_complement()
    covariance = invert_precision(hessian + precision).numpy()
    if found.outcome is Outcome.NOT_FINITE:
        covariance = np.full_like(covariance, np.nan)
    return Refit(
        path, parameters, found.shared, found.blocks, covariance, found.cost, found.iterations
    )


def _precision(
    known: Known, parameters: Parameters, change: Effect | None, new: list[Effect]
) -> Array:
    """(S, S) what is known beforehand: the calibration's covariance, widened by what may have
    changed.
    """
    covariance = known.root @ known.root.T
    if change and change in new:
        covariance = block_diag(covariance, np.diag(spread_of(change) ** 2))
    elif change:
        entries = parameters.entries(u.param.name for u in change.effect_parameters)
        covariance = covariance.copy()
        covariance[entries, entries] += spread_of(change) ** 2
    return invert_precision(torch.from_numpy(covariance)).numpy()
