"""Declared numbers that the views contradict: which one is to be doubted first.

A normal prior holds on to a wrong number: the fit ends between the number and the truth, and the
parameters beside it take up the rest. So a number that ends too far from what is declared, by the
tolerance that it has, is not believed any more.
"""

import math
from collections.abc import Collection

from calib.estimation.joint_fit import JointFit

CONTRADICTED = 3.0
"""Standard deviations: the farthest of a number that is what it is declared to be, in one of 370.
"""
DOUBT = 10.0
"""By how much the tolerance of a number is widened that is not believed: a slip of the pen, another
part, another unit.
"""
MOST_DOUBTED = 3
"""Whoever has more than that wrong should measure again before anything else."""


def apart(distance: float, tolerance: float, sigma: float) -> float:
    """How far an estimate is from what is declared, in standard deviations of what the prior lets
    that distance be.

    If the true number is drawn from the prior, the variance of estimate - declared is the prior's
    less the posterior's.
    """
    variance = tolerance**2 - sigma**2
    return abs(distance) / variance**0.5 if variance > 0 else 0.0


def apart_without(distance: float, tolerance: float, sigma: float) -> float:
    """The same of an estimate that owes nothing to what is declared: its variance and the
    tolerance's add.
    """
    return abs(distance) / math.hypot(tolerance, sigma)


def still_contradicted(joint: JointFit, name: str, tolerance: float) -> bool:
    """Whether a number whose prior was widened is told by the views, away from what is declared; or
    they only let go of it.
    """
    distance = float(joint.values[name] - joint.parameters.origin[name])
    return (
        joint.finite
        and apart_without(distance, tolerance, float(joint.sigma_of(name))) > CONTRADICTED
    )


def farthest(joint: JointFit, but: Collection[str] = (), beyond: float = CONTRADICTED) -> str:
    """The scalar that the views pull farthest from the mean of its prior; empty where none is
    `beyond` so many standard deviations.
    """
    if not joint.finite:
        return ""
    scalars = [
        param.name
        for param in joint.parameters.free
        if not joint.values[param.name].ndim and param.name not in but
    ]
    far = {name: _apart(joint, name) for name in scalars}
    name = max(far, key=far.__getitem__, default="")
    return name if name and far[name] > beyond else ""


def _apart(joint: JointFit, name: str) -> float:
    distance = float(joint.values[name] - joint.parameters.origin[name])
    return apart(distance, float(joint.parameters.priors.sigmas[name]), float(joint.sigma_of(name)))
