"""Decide how far a fit trusts the declared numbers: within their tolerances, exactly, or all but
the contradicted ones.

Tolerances are trusted while the estimates keep to them. If an estimate does not, its declared
number may be wrong. Widening the prior of a wrong number makes the corners far more probable (the
evidence of calib.estimation.joint_fit), and it makes the glass smoother, because the glass had to
make up for the error. Otherwise the model lacks an effect and uses the declared numbers to imitate
it: then they are held exactly.
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
from calib.fitting.other_lens import find_other_lens
from calib.fitting.stages import Fitted, Setup, fit_stages
from calib.progress import Progress
from calib.session.freeing import AUTO
from calib.session.numbers import unknown_names
from calib.session.parameter_names import number_of
from calib.session.shapes.registry import find_dimension
from calib.session.tolerances import GLASS_FIGURE

MIN_LOG_EVIDENCE_GAIN = 10.0
"""A fit whose numbers are contradicted is used only if its log evidence exceeds that of the fit
with exact numbers by this much. A hundred to one is 4.6, and the approximation of the evidence has
an error of its own. Sessions with a wrong number win by hundreds (benchmarks/declared).
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


def resolve_prior_conflict(
    fitted: Fitted,
    setup: Setup,
    nominal: Setup,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> ResolvedFit:
    """Return the fit whose treatment of the declared numbers the views support.

    - Even glass with another lens than the declared one is more probable than uneven glass: that.
    - No number is contradicted: the fit with tolerances as it is.
    - A number is contradicted and the fit leaves more than noise: the fit with `nominal`, as the
      model lacks something, which the number may imitate. If the glass would imitate it instead,
      more than glass can: the fit with tolerances and even glass.
    - A number is contradicted and the fit leaves noise: the more probable of the two. A fit with
      tolerances that is clearly more probable is tried with wider priors, which are kept if they
      resolve all contradictions and are not clearly less probable.

    If the settings do not let the fit hold numbers, only priors are widened.

    Args:
        fitted: the fit with the tolerances of `setup`.
        setup: the session with a tolerance for each free number.
        nominal: the session in which a number without a declared tolerance is exact.
    """
    observations = Observations.of(views, setup.board)
    resolved = ResolvedFit(fitted, setup, setup)
    may_hold = AUTO in settings.free and setup != nominal
    other = find_other_lens(fitted, setup, views, settings, progress)
    if other and other.is_more_probable:
        return ResolvedFit(other.fitted, other.setup, setup, other.differing)
    if _is_credible(resolved):
        return replace(resolved, rival=other.fitted) if other else resolved
    if not may_hold:
        return _widen_conflicting_priors(resolved, observations, views, settings, progress)
    exact = fit_stages(
        nominal,
        observations,
        settings,
        progress,
        decided=resolved.fitted,
        purpose="as declared",
    )
    held = ResolvedFit(exact, nominal, nominal)
    if not at_noise(resolved, views):
        height = height_spread(exact.path, exact.values, observations)
        if height <= MAX_IMITATION:
            return held
        even = fit_stages(
            setup,
            observations,
            replace(settings, grid=EVEN_GRID),
            progress,
            decided=fitted,
            purpose="even glass",
        )
        return replace(resolved, fitted=even)
    if log_evidence(exact) > log_evidence(fitted):
        again = fit_stages(
            setup,
            observations,
            settings,
            progress,
            earlier=exact,
            decided=resolved.fitted,
            purpose="from declared",
        )
        if log_evidence(again) > log_evidence(fitted):
            fitted, resolved = again, replace(resolved, fitted=again)
    if log_evidence(exact) > log_evidence(fitted):
        return held
    if _is_credible(resolved) or not _is_clearly_better(fitted, exact):
        return resolved
    widened = _widen_conflicting_priors(resolved, observations, views, settings, progress)
    is_worse = _is_clearly_better(fitted, widened.fitted)
    return resolved if is_worse or not _is_credible(widened) else widened


def _widen_conflicting_priors(
    resolved: ResolvedFit,
    observations: Observations,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> ResolvedFit:
    """Widen the prior of one contradicted number after another by PRIOR_INFLATION and refit.

    It stops when a refit no longer determines the number from the views, away from its declared
    value.
    """
    while (
        (joint := resolved.fitted.joint)
        and len(resolved.doubted) < MAX_CONFLICTS
        and at_noise(resolved, views)
    ):
        name = largest_prior_conflict(joint, (*resolved.doubted, *_unknown(resolved)))
        if not name:
            break
        intrinsics, cover = widen_prior(
            resolved.setup.intrinsics, resolved.setup.cover, name, PRIOR_INFLATION
        )
        wider = replace(resolved.setup, intrinsics=intrinsics, cover=cover)
        refitted = fit_stages(
            wider,
            observations,
            settings,
            progress,
            decided=resolved.fitted,
            purpose=f"free {short_name(name)}",
        )
        if not (
            refitted.joint
            and contradicts_prior(refitted.joint, name, float(joint.parameters.priors.sigmas[name]))
        ):
            break
        resolved = ResolvedFit(refitted, wider, resolved.declared, (*resolved.doubted, name))
    return resolved


def _is_credible(resolved: ResolvedFit) -> bool:
    """True if the fit converged to numbers that keep to their tolerances."""
    joint = resolved.fitted.joint
    return not joint or (
        joint.outcome is Outcome.CONVERGED and not largest_prior_conflict(joint, _unknown(resolved))
    )


def _unknown(resolved: ResolvedFit) -> tuple[str, ...]:
    """Return the names of the unknown numbers, which contradict nothing that was declared."""
    return unknown_names(resolved.setup.intrinsics, resolved.setup.cover)


def _is_clearly_better(fitted: Fitted, exact: Fitted) -> bool:
    return log_evidence(fitted) > log_evidence(exact) + MIN_LOG_EVIDENCE_GAIN


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
