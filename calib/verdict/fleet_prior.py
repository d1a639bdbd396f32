"""Check: the camera belongs to the fleet of its prior."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.verdict import Reason


def fleet_prior(case: Case) -> Iterator[Reason]:
    """Report a prior that the views contradict, which the fit left out. The camera is of another
    make or broken, or the prior is for other cameras.
    """
    prior = case.calibration.outcome.fleet_prior
    if not prior or prior.used:
        return
    farthest = (
        f", {prior.farthest} by {prior.farthest_sigmas:.1f} standard deviations"
        if prior.farthest
        else ""
    )
    yield Reason(
        f"this camera differs from the {prior.cameras} cameras of {prior.file} (p ="
        f" {prior.p_value:.1g}{farthest}), so their prior was not used: look at this camera, or"
        " name a prior of cameras like it.",
        case.next.fit(),
        (prior.farthest,) if prior.farthest else (),
    )
