"""Which parameters a session states with a standard deviation: these are the free ones of the joint
fit, and take its estimates.
"""

from dataclasses import replace

from calib.estimation.joint_fit import JointFit
from calib.estimation.priors import Priors
from calib.optics.path import Path
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.numbers import correlations_of, numbers_of, replace_correlations, replace_numbers


def priors_of(intrinsics: Intrinsics, cover: Cover, path: Path) -> Priors:
    """Of each parameter of the path that is described with a standard deviation (SI units)."""
    known = {param.name for param in path.params}
    sigmas = {
        name: number.sigma
        for name, number in numbers_of(intrinsics, cover).items()
        if number.sigma > 0 and name in known
    }
    return Priors(sigmas, correlations_of(intrinsics, cover), glass=cover.glass)


def with_estimates(
    intrinsics: Intrinsics, cover: Cover, joint: JointFit | None
) -> tuple[Intrinsics, Cover]:
    """The same description with the estimates and their standard deviations; parameters of a fit
    that is not finite stay as stated. How the estimates are correlated the fit's covariance says.
    Without a fit, the description stays as stated, with its correlations.
    """
    if joint is None:
        return intrinsics, cover
    found = joint.estimates()
    if not joint.finite:
        stated = numbers_of(intrinsics, cover)
        found = {
            name: replace(number, sigma=stated[name].sigma)
            for name, number in found.items()
            if name in stated
        }
    return replace_numbers(intrinsics, cover, found)


def widened(
    intrinsics: Intrinsics, cover: Cover, name: str, factor: float
) -> tuple[Intrinsics, Cover]:
    """The same description with the standard deviation of one number, as the path calls it,
    `factor` times as large.

    It keeps its covariances, as if an error that owes nothing to the others were added to it: so
    the prior is looser in every direction. If it kept its correlations instead, or lost them, the
    prior would grow tighter in some, without a reason.
    """
    number, correlations = numbers_of(intrinsics, cover)[name], correlations_of(intrinsics, cover)
    wider = replace_numbers(intrinsics, cover, {name: replace(number, sigma=factor * number.sigma)})
    wider = replace_correlations(
        *wider,
        {pair: value / factor if name in pair else value for pair, value in correlations.items()},
    )
    return wider[0], replace(wider[1], glass=cover.glass)
