"""Air or water outside of the cover: which of the two the views show, where other numbers of camera
and cover are unknown and could make up for a wrong medium.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calib.corners.view import View
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_or_none
from calib.fitting.unknown_numbers import with_initial_values
from calib.progress import Progress
from calib.session.numbers import unknown_names
from calib.session.schema import Number
from calib.session.shapes.layer import MEDIA, medium_word, opposite_medium

TOLD = 0.05
"""The standard deviation of an outside index below which it says which medium is meant."""
COMPARED_VIEWS = 12
"""Views of the first comparison, with even glass: where the medium can be told, eight tell it."""
LIKELY = 7.0
"""The log odds from which the other medium is fitted to all views, with uneven glass."""
NEAR_NOISE = 3.0
"""The error over the corners' noise up to which a fit explains the views. The evidence of two fits
that both leave far more tells nothing: fixtures/bump leaves 7 and 15 times its noise, and the odds
of water are e^-44 with even glass and e^1055 with uneven glass.
"""


def medium_log_odds(
    setup: Setup, fitted: Fitted, views: Sequence[View], settings: Settings, progress: Progress
) -> Mapping[str, float] | None:
    """Return the logarithm of the odds of air and of water, 0 for the more probable one; None if
    every number is known, or the medium itself is estimated.

    Args:
        setup: the setup of the session, with a start for its unknown numbers.
        fitted: its fit to the views.
    """
    medium = setup.cover.medium
    is_told = medium and medium.sigma < TOLD and not medium.unknown
    if not is_told or not unknown_names(setup.intrinsics, setup.cover):
        return None
    if not (fitted.joint and fitted.joint.finite):
        return None
    assert medium
    stated = medium_word(medium.value)
    rival_name = opposite_medium(medium.value)
    cover = setup.cover.replace_medium(Number(MEDIA[rival_name]), None)
    rival = replace(setup, cover=cover, initial={})
    sample = views[:: -(-len(views) // COMPARED_VIEWS)]
    even_glass = replace(settings, grid=EVEN_GRID)
    rival = with_initial_values(rival, sample, progress)
    rival_fit = fit_or_none(rival, sample, even_glass, progress, f"if in {rival_name}")
    fit = fit_or_none(setup, sample, even_glass, progress, f"if in {stated}")
    log_odds = _log_marginal(rival_fit) - _log_marginal(fit) if rival_fit and fit else 0.0
    if log_odds > LIKELY:
        rival_fit = fit_or_none(rival, views, settings, progress, f"if in {rival_name}")
        if rival_fit and rival_fit.leaves_noise(views, setup.board, NEAR_NOISE):
            log_odds = min(log_odds, _log_marginal(rival_fit) - fitted.joint.log_marginal)
        else:
            log_odds = 0.0
    best = max(log_odds, 0.0)
    return {stated: 0.0 - best, rival_name: log_odds - best}


def _log_marginal(fitted: Fitted) -> float:
    assert fitted.joint
    return fitted.joint.log_marginal
