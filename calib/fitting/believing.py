"""What of that which a session declares a fit believes: that it is within its tolerances, that it
is exact, or that a number is wrong.

Tolerances are believed as long as the estimates keep to them. Where they do not, a number may be
wrong: then doubting it makes the corners far more probable (the evidence of
calib.estimation.joint_fit), and the glass smooth, which had to make up for it. Or a model that
lacks something uses its numbers for that, and they are held.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.corners.view import View
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.noise import on_board_grid, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.prior_conflict import (
    MAX_CONFLICTS,
    PRIOR_INFLATION,
    contradicts_prior,
    largest_prior_conflict,
)
from calib.estimation.relief_heights import height_spread
from calib.estimation.stated_priors import widen_prior
from calib.fitting.stages import Fitted, Settings, Setup, fit_stages
from calib.progress import Progress
from calib.session.freeing import AUTO

SMOOTHER = 0.5
"""Of the unevenness with every number exact: a wrong number that is put right leaves less, as the
glass no longer has to make up for it. Of four wrong sessions 0.09 to 0.18 was left
(benchmarks/declared); `bumps`, all true, would have had 1.4 with a radius of 89 mm for 42.
"""
DECISIVE = 10.0
"""Logarithm: by so much must a fit whose numbers are contradicted be the more probable one to be
believed. A hundred to one is 4.6, and the approximation is off by some; wrong sessions win by
hundreds (benchmarks/declared).
"""
STRAINED = 2.5
"""Standard deviations: short of a contradiction, but so far that numbers held exactly have to make
the corners less probable. An offset of `bumps`, where all is true, ends on either side of three by
a ten-thousandth of a pixel.
"""
AT_NOISE = 1.3
"""Of the corners' noise: a fit that leaves more lacks something else, which may be what pulls a
number away.
"""


@dataclass(frozen=True, slots=True)
class Believed:
    """A fit, and what it was told."""

    fitted: Fitted
    setup: Setup
    """With the tolerances that it was fitted with."""
    declared: Setup
    """With those that its numbers were declared with."""
    doubted: tuple[str, ...] = ()
    """The numbers whose tolerance was widened, as the ray path calls them."""


def believing(
    fitted: Fitted,
    setup: Setup,
    told: Setup,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> Believed:
    """A fit with tolerances (`setup`) as it is, if none of its numbers is contradicted, and none is
    strained, or it is more probable than one in which what has no tolerance of its own is exact
    (`told`). If a number is contradicted, a fit that doubts it, if that leaves none and is better
    than with exact numbers; else the latter, if the settings allow it.
    """
    observations = Observations.of(views, setup.board)
    believed = Believed(fitted, setup, setup)
    credible, may_hold = _credible(fitted), AUTO in settings.free and setup != told
    if credible and not (
        may_hold and fitted.joint and largest_prior_conflict(fitted.joint, threshold=STRAINED)
    ):
        return believed
    if not may_hold:
        return _doubting(believed, observations, views, settings, progress)
    exact = fit_stages(told, observations, settings, progress, purpose="numbers as declared")
    if credible:
        return (
            believed if log_evidence(fitted) > log_evidence(exact) else Believed(exact, told, told)
        )
    if _decisive(fitted, exact):
        believed = _doubting(believed, observations, views, settings, progress)
        ours, theirs = (
            height_spread(one.path, one.values, observations) for one in (believed.fitted, exact)
        )
        if (
            _credible(believed.fitted)
            and _decisive(believed.fitted, exact)
            and ours < SMOOTHER * theirs
        ):
            return believed
    return Believed(exact, told, told)


def _doubting(
    believed: Believed,
    observations: Observations,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> Believed:
    """With DOUBT times its tolerance for one contradicted number after the other, as long as the
    views then tell the number, away from what is declared.
    """
    while (
        (joint := believed.fitted.joint)
        and len(believed.doubted) < MAX_CONFLICTS
        and at_noise(believed, views)
    ):
        name = largest_prior_conflict(joint, believed.doubted)
        if not name:
            break
        intrinsics, cover = widen_prior(
            believed.setup.intrinsics, believed.setup.cover, name, PRIOR_INFLATION
        )
        wider = replace(believed.setup, intrinsics=intrinsics, cover=cover)
        again = fit_stages(
            wider, observations, settings, progress, purpose=f"{name.partition('.')[2]} doubted"
        )
        if not (
            again.joint
            and contradicts_prior(again.joint, name, float(joint.parameters.priors.sigmas[name]))
        ):
            break
        believed = Believed(again, wider, believed.declared, (*believed.doubted, name))
    return believed


def _credible(fitted: Fitted) -> bool:
    """Whether the fit converged, to numbers that keep to their tolerances."""
    joint = fitted.joint
    return not joint or (joint.outcome is Outcome.CONVERGED and not largest_prior_conflict(joint))


def _decisive(doubting: Fitted, exact: Fitted) -> bool:
    return log_evidence(doubting) > log_evidence(exact) + DECISIVE


def log_evidence(fitted: Fitted) -> float:
    """Of the corners, up to a constant of them."""
    return fitted.joint.log_evidence if fitted.joint else -math.inf


def at_noise(believed: Believed, views: Sequence[View]) -> bool:
    """Whether a fit leaves little but the corners' noise."""
    fitted = believed.fitted
    return fitted.stages[-1].rms_px <= AT_NOISE * short_scale_noise(
        on_board_grid(fitted.residuals.image, views), believed.setup.board
    )
