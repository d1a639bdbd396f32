"""Standard deviations of unknown numbers where the error over them is no parabola.

A number with a wide prior may lie in a curved valley: the lens makes up for the place of a dome
over centimetres, each time by other values. The covariance at the optimum knows the bend of the
valley's walls there, not its length. So each such number is held at places farther and farther from
its estimate, everything else is fitted anew, and the fall of the posterior says how far it is
known.

Source: D. M. Bates, D. G. Watts, Nonlinear regression analysis and its applications (1988), section
    6.1: the profile likelihood.
"""

from collections.abc import Iterable
from dataclasses import replace

import torch
from torch import Tensor

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import WARM_ROUNDS, JointFit, Start
from calib.estimation.objective import HUBER
from calib.estimation.observations import Observations
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals

LEVEL = 2.0
"""Standard deviations at which a number is held first, and by which the posterior has to fall."""
MAX_STEPS = 4
"""The most places on either side, each twice as far as the one before."""
MIN_FACTOR = 1.5
"""The least factor by which a standard deviation is widened: profiles of exact parabolas are off by
what a fit leaves of its tolerance.
"""


def widen_valleys(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    wide: JointFit,
    names: Iterable[str],
) -> tuple[JointFit, dict[str, float]]:
    """Return the wide fit with the standard deviation of each number, and of whatever follows it,
    as large as its profile says, and the variance of each number by its profile, over its scale
    squared.

    Args:
        model: the model of the fit.
        observations: its corners.
        joint: the fit, with the covariance of independent corners, as the profile has it.
        wide: the same with the covariance to widen.
        names: scalars of the path.
    """
    slices = joint.parameters.slices()
    covariance = wide.covariance
    variances: dict[str, float] = {}
    for name in names:
        if not joint.finite or name not in slices:
            continue
        factor = _profile_factor(model, observations, joint, name)
        if factor > MIN_FACTOR:
            at = slices[name].start
            variances[name] = factor**2 * float(wide.covariance[at, at])
            covariance = with_variance(covariance, at, factor**2 * float(covariance[at, at]))
    return replace(wide, covariance=covariance), variances


def with_variance(covariance: Tensor, at: int, variance: float) -> Tensor:
    """Return the (S, S) covariance with another variance of one parameter: whatever depends on it
    follows.
    """
    column, before = covariance[:, at], float(covariance[at, at])
    return covariance + torch.outer(column, column) * (variance - before) / before**2


def _profile_factor(
    model: CameraModel, observations: Observations, joint: JointFit, name: str
) -> float:
    """Return the standard deviation by the profile over that of the covariance: the larger of the
    two sides.
    """
    sigma = float(joint.sigma_of(name))
    estimate, mean = float(joint.values[name]), float(model.means[name])
    prior_sigma = torch.as_tensor(model.priors.sigmas[name])
    minimum = _surprise(model, observations, joint, joint.sigma)
    factors = [1.0]
    for side in (-1.0, 1.0):
        fit, distance = joint, LEVEL
        for _ in range(MAX_STEPS):
            value = estimate + side * distance * sigma
            held, fit = _held(model, name, value, observations, fit)
            prior = float(((value - mean) / prior_sigma) ** 2)
            fall = _surprise(held, observations, fit, joint.sigma) + prior - minimum
            factors.append(distance / max(fall, 1.0) ** 0.5)
            if not fall < LEVEL**2:  # also where the camera would be outside of its cover
                break
            distance *= 2
    return max(factors)


def _surprise(model: CameraModel, observations: Observations, fit: JointFit, sigma: float) -> float:
    """Return -2 log of the posterior, up to a constant: the robust squares of the reprojection
    errors over sigma squared, and those of the priors. The fit's own cost takes the error on the
    board, turned to pixels near each optimum, and does not compare places that are far apart.
    """
    image = residuals(model.path, fit.values, observations, fit.poses).image
    size = torch.linalg.vector_norm(image, dim=-1) * observations.weight / sigma
    squares = torch.where(size < HUBER, size**2, 2 * HUBER * size - HUBER**2)
    vector = fit.parameters.vector(fit.values).numpy()
    precision = fit.parameters.prior_precision(fit.smoothness)
    return float(squares.sum()) + float(vector @ precision @ vector)


def _held(
    model: CameraModel, name: str, value: float, observations: Observations, near: JointFit
) -> tuple[CameraModel, JointFit]:
    """Return the model with a number held, and its fit from one near by, with the same noise and
    smoothness.
    """
    priors = model.priors
    sigmas = {param: sigma for param, sigma in priors.sigmas.items() if param != name}
    correlations = {pair: c for pair, c in priors.correlations.items() if name not in pair}
    means = {**model.means, name: torch.tensor(value, dtype=torch.float64)}
    held = CameraModel(
        model.path, means, Priors(sigmas, correlations, priors.roots, priors.glass), model.effects
    )
    start = Start({**near.values, name: means[name]}, near.sigma, near.smoothness)
    return held, held.fit(observations, near.poses, start, WARM_ROUNDS)
