"""The parameters that a session states with a standard deviation. They are the free parameters of
the joint fit and take its estimates.
"""

from dataclasses import replace

from calib.estimation.joint_fit import Estimate
from calib.estimation.priors import Priors
from calib.optics.path import Path
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.numbers import correlations_of, numbers_of, replace_correlations, replace_numbers


def priors_of(intrinsics: Intrinsics, cover: Cover, path: Path) -> Priors:
    """Return the priors of the path's parameters that have a standard deviation (SI units)."""
    names = {param.name for param in path.params}
    sigmas = {
        name: number.sigma
        for name, number in numbers_of(intrinsics, cover).items()
        if number.sigma > 0 and name in names
    }
    return Priors(sigmas, correlations_of(intrinsics, cover), glass=cover.glass)


def with_estimates(
    intrinsics: Intrinsics, cover: Cover, joint: Estimate | None
) -> tuple[Intrinsics, Cover]:
    """Return the same description with the estimates and their standard deviations. If the fit is
    not finite, the standard deviations stay as stated. The correlations of the estimates are in the
    fit's covariance. Without a fit, the description stays as stated, with its correlations.
    """
    if joint is None:
        return intrinsics, cover
    estimates = joint.estimates()
    if not joint.finite:
        stated = numbers_of(intrinsics, cover)
        estimates = {
            name: replace(number, sigma=stated[name].sigma)
            for name, number in estimates.items()
            if name in stated
        }
    return replace_numbers(intrinsics, cover, estimates)


def widen_prior(
    intrinsics: Intrinsics, cover: Cover, name: str, factor: float
) -> tuple[Intrinsics, Cover]:
    """Return the same description with the standard deviation of one number multiplied by `factor`.
    The name is that of the path's parameter.

    The covariances with other numbers stay the same, as if an independent error were added: so the
    prior becomes looser in every direction. With the same correlations, or without any, it would
    become tighter in some direction for no reason.
    """
    number = numbers_of(intrinsics, cover)[name]
    correlations = correlations_of(intrinsics, cover)
    wider = replace_numbers(intrinsics, cover, {name: replace(number, sigma=factor * number.sigma)})
    wider = replace_correlations(
        *wider,
        {pair: value / factor if name in pair else value for pair, value in correlations.items()},
    )
    return wider[0], replace(wider[1], glass=cover.glass)
