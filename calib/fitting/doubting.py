"""A fit that gives up the tolerance of declared numbers that the views contradict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.corners.view import View
from calib.estimation.doubt import DOUBT, MOST_DOUBTED, farthest, still_contradicted
from calib.estimation.noise import on_board, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import widened
from calib.fitting.stages import Fitted, Settings, Setup, fit_stages
from calib.progress import Progress

AT_NOISE = 1.3
"""Of the corners' noise: a fit that leaves more lacks something else, which may be what pulls a number away."""


@dataclass(frozen=True, slots=True)
class Believed:
    """A fit, and what it was told."""

    fitted: Fitted
    setup: Setup
    """With the tolerances that it was fitted with."""
    doubted: tuple[str, ...]
    """The numbers whose tolerance was widened, as the ray path calls them."""


def doubting(fitted: Fitted, setup: Setup, views: Sequence[View], settings: Settings, progress: Progress) -> Believed:
    """The fit, or one after it in which the numbers that are contradicted most have DOUBT times their tolerance: one after the other, as
    long as the views then tell the number, away from what is declared."""
    doubted: tuple[str, ...] = ()
    while fitted.joint and len(doubted) < MOST_DOUBTED and _at_noise(fitted, views, setup):
        name = farthest(fitted.joint, doubted)
        if not name:
            break
        intrinsics, cover = widened(setup.intrinsics, setup.cover, name, DOUBT)
        wider = replace(setup, intrinsics=intrinsics, cover=cover)
        again = fit_stages(wider, Observations.of(views, setup.board), settings, progress)
        if not (again.joint and still_contradicted(again.joint, name, float(fitted.joint.parameters.sigmas[name]))):
            break
        fitted, setup, doubted = again, wider, (*doubted, name)
    return Believed(fitted, setup, doubted)


def _at_noise(fitted: Fitted, views: Sequence[View], setup: Setup) -> bool:
    return fitted.stages[-1].rms_px <= AT_NOISE * short_scale_noise(on_board(fitted.residuals.image, views), setup.board)
