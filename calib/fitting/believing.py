"""What of that which a session declares a fit believes: that it is within its tolerances, that it is exact, or that a number is wrong.

Tolerances are believed as long as the estimates keep to them. Where they do not, it may be that a model which lacks something used its
numbers to make up for it: exact ones are then about as probable (by the evidence, as in calib.estimation.joint_fit), and stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.corners.view import View
from calib.estimation.doubt import DOUBT, MOST_DOUBTED, farthest, still_contradicted
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.noise import on_board, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import widened
from calib.fitting.stages import Fitted, Settings, Setup, fit_stages
from calib.progress import Progress
from calib.session.freeing import AUTO

DECISIVE = 10.0
"""Logarithm: by so much must a fit whose numbers are contradicted be the more probable one to be believed. The least wrong of wrong
sessions, with a slope of the wrong sign, wins by 59; blind-e, whose glass is uneven by tens of micrometres, by 3, with an index of 2.1."""
AT_NOISE = 1.3
"""Of the corners' noise: a fit that leaves more lacks something else, which may be what pulls a number away."""


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


def believing(fitted: Fitted, setup: Setup, told: Setup, views: Sequence[View], settings: Settings, progress: Progress) -> Believed:
    """A fit with tolerances (`setup`) as it is, if none of its numbers is contradicted. Else the one in which what has no tolerance of its
    own is exact (`told`), if it may be and is about as probable; or numbers that are contradicted get DOUBT times their tolerance,
    one after the other, as long as the views then tell the number, away from what is declared."""
    observations = Observations.of(views, setup.board)
    if AUTO in settings.free and setup != told and not _credible(fitted):
        exact = fit_stages(told, observations, settings, progress)
        if _evidence(fitted) < _evidence(exact) + DECISIVE:
            return Believed(exact, told, told)
    declared = setup
    doubted: tuple[str, ...] = ()
    while fitted.joint and len(doubted) < MOST_DOUBTED and _at_noise(fitted, views, setup):
        name = farthest(fitted.joint, doubted)
        if not name:
            break
        intrinsics, cover = widened(setup.intrinsics, setup.cover, name, DOUBT)
        wider = replace(setup, intrinsics=intrinsics, cover=cover)
        again = fit_stages(wider, observations, settings, progress)
        if not (again.joint and still_contradicted(again.joint, name, float(fitted.joint.parameters.priors.sigmas[name]))):
            break
        fitted, setup, doubted = again, wider, (*doubted, name)
    return Believed(fitted, setup, declared, doubted)


def _credible(fitted: Fitted) -> bool:
    """Whether the fit converged, to numbers that keep to their tolerances."""
    joint = fitted.joint
    return not joint or (joint.outcome is Outcome.CONVERGED and not farthest(joint))


def _evidence(fitted: Fitted) -> float:
    return fitted.joint.log_evidence if fitted.joint else -math.inf


def _at_noise(fitted: Fitted, views: Sequence[View], setup: Setup) -> bool:
    return fitted.stages[-1].rms_px <= AT_NOISE * short_scale_noise(on_board(fitted.residuals.image, views), setup.board)
