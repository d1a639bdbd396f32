"""Decide how far a fit trusts the declared numbers.

A declared number is a measurement with a tolerance. A fit with tolerances estimates all declared
numbers. If an estimate is far outside its tolerance, there are two explanations, and this module
decides between them:

- The declared number is wrong. Then the corners are far more probable with a wider tolerance (the
  evidence of calib.estimation.joint_fit), and the glass becomes smoother, because it had to make up
  for the error. The number is estimated with a wider tolerance.
- The model lacks something, such as a bent board, and the number moved to imitate it. Then the
  numbers are held at their declared values.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.corners.view import View
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.prior_conflict import (
    MAX_CONFLICTS,
    PRIOR_INFLATION,
    contradicts_prior,
    largest_prior_conflict,
)
from calib.estimation.relief_heights import height_spread
from calib.estimation.stated_priors import widen_prior
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.fitted import Fitted
from calib.fitting.other_lens import find_other_lens
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Progress
from calib.session.freeing import AUTO
from calib.session.numbers import unknown_names
from calib.session.parameter_names import number_of
from calib.session.shapes.registry import find_dimension
from calib.session.tolerances import GLASS_FIGURE

MIN_LOG_EVIDENCE_GAIN = 10.0
"""A fit whose numbers are contradicted is used only if its log evidence exceeds that of the fit
with the declared values by this much. A hundred to one is 4.6, and the approximation of the
evidence has an error of its own. Sessions with a wrong number win by hundreds
(benchmarks/declared).
"""
MAX_IMITATION = 7.5 * GLASS_FIGURE.sigma
"""m, root mean square: glass that is more uneven, in a fit that leaves more than noise, is not what
is there. A board that moves during the readout gave 57 um, measured sets in water 100 and 150 um,
the latter two with the cover's distance wrong by ten of its sigmas.
"""


@dataclass(frozen=True, slots=True)
class ResolvedFit:
    """A fit with the priors that it used."""

    fitted: Fitted
    setup: Setup
    """The setup with the tolerances of the fit."""
    declared: Setup
    """The setup with the tolerances that were declared."""
    doubted: tuple[str, ...] = ()
    """The numbers whose tolerance was widened, by their names in the ray path."""
    rival: Fitted | None = None
    """The fit of even glass and another lens that explains the views about as well."""


@dataclass(frozen=True, slots=True)
class _Refits:
    """Further fits of the same views, with other tolerances."""

    observations: Observations
    views: Sequence[View]
    settings: Settings
    progress: Progress

    def fit(
        self,
        setup: Setup,
        decided: Fitted,
        purpose: str,
        *,
        grid: tuple[int, int] | None = None,
        earlier: Fitted | None = None,
    ) -> Fitted:
        """Return the fit of a setup, with the settings' grid unless another is given. The other
        arguments are those of `fit_stages`.
        """
        return fit_stages(
            setup,
            self.observations,
            replace(self.settings, grid=grid) if grid else self.settings,
            self.progress,
            earlier=earlier,
            decided=decided,
            purpose=purpose,
        )


def resolve_prior_conflict(
    fitted: Fitted,
    setup: Setup,
    fixed_setup: Setup,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> ResolvedFit:
    """Return the fit whose treatment of the declared numbers the views support.

    1. If even glass with another lens than the declared one is more probable than uneven glass, it
       is that fit.
    2. If all estimates keep to their tolerances, it is the fit with tolerances, as it is.
    3. If the settings do not let the fit hold numbers, tolerances are widened
       (`_widen_tolerances`).
    4. If the fit with tolerances leaves more than noise, the model lacks something: the numbers are
       held (`_hold_numbers`).
    5. Else it is the more probable of both fits (`_more_probable`).

    Args:
        fitted: the fit with the tolerances of `setup`.
        setup: the session with a tolerance for each free number.
        fixed_setup: the session as it is declared. A number without a sigma of its own is held at
            its declared value.
        views: the views of the fit.
        settings: the settings of the fit.
        progress: the place for progress bars.
    """
    tolerant = ResolvedFit(fitted, setup, setup)
    other = find_other_lens(fitted, setup, views, settings, progress)
    if other and other.is_more_probable:
        return ResolvedFit(other.fitted, other.setup, setup, other.differing)
    if _keeps_tolerances(tolerant):
        return replace(tolerant, rival=other.fitted) if other else tolerant
    refits = _Refits(Observations.of(views, setup.board), views, settings, progress)
    can_hold_numbers = AUTO in settings.free and setup != fixed_setup
    if not can_hold_numbers:
        return _widen_tolerances(tolerant, refits)
    fixed_fit = refits.fit(fixed_setup, fitted, "as declared")
    fixed = ResolvedFit(fixed_fit, fixed_setup, fixed_setup)
    if not at_noise(tolerant, views):
        return _hold_numbers(tolerant, fixed, refits)
    return _more_probable(tolerant, fixed, refits)


def _hold_numbers(tolerant: ResolvedFit, fixed: ResolvedFit, refits: _Refits) -> ResolvedFit:
    """Return the fit with the declared values, for a model that lacks something. If the glass would
    imitate it, by more than glass can be uneven, return a fit with tolerances and even glass.
    """
    fit = fixed.fitted
    if height_spread(fit.path, fit.values, refits.observations) <= MAX_IMITATION:
        return fixed
    even = refits.fit(tolerant.setup, tolerant.fitted, "even glass", grid=EVEN_GRID)
    return replace(tolerant, fitted=even)


def _more_probable(tolerant: ResolvedFit, fixed: ResolvedFit, refits: _Refits) -> ResolvedFit:
    """Return the more probable fit of two: the one with tolerances, which leaves no more than
    noise, and the one with the declared values.

    If the fit with tolerances is the less probable one, it may have ended in the wrong place: it is
    fitted again, from the other one. If it is clearly the more probable one, wider tolerances are
    tried. They are kept if they resolve all contradictions and are not clearly less probable.
    """
    if log_evidence(fixed.fitted) > log_evidence(tolerant.fitted):
        restarted = refits.fit(
            tolerant.setup, tolerant.fitted, "from declared", earlier=fixed.fitted
        )
        if log_evidence(restarted) > log_evidence(tolerant.fitted):
            tolerant = replace(tolerant, fitted=restarted)
    if log_evidence(fixed.fitted) > log_evidence(tolerant.fitted):
        return fixed
    if _keeps_tolerances(tolerant) or not _is_clearly_better(tolerant.fitted, fixed.fitted):
        return tolerant
    widened = _widen_tolerances(tolerant, refits)
    is_worse = _is_clearly_better(tolerant.fitted, widened.fitted)
    return tolerant if is_worse or not _keeps_tolerances(widened) else widened


def _widen_tolerances(resolved: ResolvedFit, refits: _Refits) -> ResolvedFit:
    """Widen the tolerance of one contradicted number after another by PRIOR_INFLATION and refit.

    It stops when a refit no longer determines the number from the views, away from its declared
    value.
    """
    while (
        (joint := resolved.fitted.joint)
        and len(resolved.doubted) < MAX_CONFLICTS
        and at_noise(resolved, refits.views)
    ):
        name = largest_prior_conflict(joint, (*resolved.doubted, *_unknown(resolved)))
        if not name:
            break
        intrinsics, cover = widen_prior(
            resolved.setup.intrinsics, resolved.setup.cover, name, PRIOR_INFLATION
        )
        wider = replace(resolved.setup, intrinsics=intrinsics, cover=cover)
        refitted = refits.fit(wider, resolved.fitted, f"free {short_name(name)}")
        sigma = float(joint.parameters.priors.sigmas[name])
        if not (refitted.joint and contradicts_prior(refitted.joint, name, sigma)):
            break
        resolved = ResolvedFit(refitted, wider, resolved.declared, (*resolved.doubted, name))
    return resolved


def _keeps_tolerances(resolved: ResolvedFit) -> bool:
    """True if the fit converged to numbers that keep to their tolerances."""
    joint = resolved.fitted.joint
    return not joint or (
        joint.outcome is Outcome.CONVERGED and not largest_prior_conflict(joint, _unknown(resolved))
    )


def _unknown(resolved: ResolvedFit) -> tuple[str, ...]:
    """Return the names of the unknown numbers, which contradict nothing that was declared."""
    return unknown_names(resolved.setup.intrinsics, resolved.setup.cover)


def _is_clearly_better(better: Fitted, worse: Fitted) -> bool:
    """True if the first fit is more probable by far than the second."""
    return log_evidence(better) > log_evidence(worse) + MIN_LOG_EVIDENCE_GAIN


def log_evidence(fitted: Fitted) -> float:
    """Return the log evidence up to a constant of the corners; -inf without a joint fit."""
    return fitted.joint.log_evidence if fitted.joint else -math.inf


def at_noise(resolved: ResolvedFit, views: Sequence[View]) -> bool:
    """True if the residual is little more than the corners' noise, and this is known."""
    return resolved.fitted.leaves_noise(views, resolved.setup.board)


def short_name(name: str) -> str:
    """Return the name of a number as `--free` has it, such as offset.x for cover.axis_offset.x."""
    number = number_of(name) or name.partition(".")[2]
    stem, _, axis = number.partition(".")
    dimension = find_dimension(number)
    option = dimension.option if dimension else ""
    return ".".join(filter(None, (option or stem, axis)))
