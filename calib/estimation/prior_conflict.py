"""Declared values that the views contradict, and which of them to distrust first.

A normal prior holds on to a wrong value: the fit ends between the declared value and the truth, and
the other parameters compensate for the rest. So a value whose estimate ends too far from the
declared one, compared with its tolerance, gets a wider prior.
"""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from calib.estimation.joint_fit import JointFit
from calib.session.deviation import independent_deviation, normalised_deviation

CONFLICT_THRESHOLD = 3.5
"""Standard deviations: of the twelve or so numbers of a cover and a camera, all declared correctly,
one deviates by more in one session of 180. With 3 it would be one in 31.
"""
MIN_SPREAD = 0.75
"""The smallest standard deviation, as a fraction of the tolerance, that the distance between
estimate and declared value is compared with: nobody is told to measure again what is off by one
tolerance.
"""
PRIOR_INFLATION = 10.0
"""The factor by which the tolerance of a distrusted value is widened: enough for a slip of the pen,
another part, or another unit.
"""
MAX_CONFLICTS = 3
"""A user with more wrong values than this should measure again before anything else."""


def contradicts_prior(joint: JointFit, name: str, tolerance: float) -> bool:
    """True if the views, with the widened prior, put the value away from the declared one; False if
    they merely leave it open.
    """
    distance = float(joint.values[name] - joint.parameters.origin[name])
    return (
        joint.finite
        and abs(independent_deviation(distance, tolerance, float(joint.sigma_of(name))))
        > CONFLICT_THRESHOLD
    )


def largest_prior_conflict(
    joint: JointFit, excluded: Collection[str] = (), threshold: float = CONFLICT_THRESHOLD
) -> str:
    """Return the name of the scalar that the views pull farthest from the mean of its prior; empty
    if none deviates by more than `threshold` standard deviations.
    """
    if not joint.finite:
        return ""
    scalars = [
        param.name
        for param in joint.parameters.free
        if not joint.values[param.name].ndim and param.name not in excluded
    ]
    deviations = {name: _deviation(joint, name) for name in scalars}
    name = max(deviations, key=deviations.__getitem__, default="")
    return name if name and deviations[name] > threshold else ""


def _deviation(joint: JointFit, name: str) -> float:
    distance = float(joint.values[name] - joint.parameters.origin[name])
    tolerance = float(joint.parameters.priors.sigmas[name])
    sigma = float(joint.sigma_of(name))
    return abs(float(normalised_deviation(distance, tolerance, sigma, min_spread=MIN_SPREAD)))


def log_odds_of_swap(
    deviation: NDArray[np.floating],
    covariance: NDArray[np.floating],
    tolerances: NDArray[np.floating],
) -> float:
    """Return the log odds that of two declared values the second is wrong in place of the first.

    The fit widened the first one's prior by `PRIOR_INFLATION`. Its normal posterior tells, without
    another fit, how probable the corners are if the second one's prior is wide instead: the mean
    over the posterior of the ratio of both priors. Minus infinity if this mean is not finite.

    Args:
        deviation: (2,) the estimates minus the declared values.
        covariance: (2, 2) of the estimates.
        tolerances: (2,) standard deviations of the declared values.
    """
    wide = 1 - PRIOR_INFLATION**-2.0
    change = np.diag([wide, -wide] / tolerances**2)  # of the inverse prior variances
    precision = np.linalg.inv(covariance)
    changed = precision + change
    if np.linalg.eigvalsh(changed)[0] <= 0:
        return -np.inf
    pull = precision @ deviation
    gain = pull @ np.linalg.solve(changed, pull) - deviation @ pull
    return float(gain + np.linalg.slogdet(precision)[1] - np.linalg.slogdet(changed)[1]) / 2
