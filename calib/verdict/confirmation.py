"""The declared numbers that the views confirm, contradict or leave open, by the cost in depth and
length.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calib.estimation.prior_conflict import CONFLICT_THRESHOLD
from calib.fitting.declared import DECLARED, Comparison, comparisons
from calib.session.freeing import AUTO
from calib.session.numbers import numbers_of
from calib.verdict.case import Case
from calib.verdict.declared_numbers import advice_on
from calib.verdict.residual import likely_effects
from calib.verdict.scale_evidence import ScaleEvidence, scale_evidence
from calib.verdict.thresholds import (
    DOMINANT,
    NOTICED_SCALE,
    UNBOUNDED_SCALE,
    UNSURE_FOCAL,
)
from calib.verdict.verdict import Reason

POSES = "tilt the board by 20 to 40 degrees, to each side and up and down, at several distances"
"""The poses that determine a focal length and a cover."""


def contradicted_numbers(case: Case) -> Iterator[Reason]:
    """Name the numbers that the fit held and the views contradict, where that changes depth and
    length: by more than what is accepted, or by more than the declaration allows.
    """
    evidence = _evidence(case)
    if not evidence or not case.at_optimum:
        return
    held = _held(case)
    change = abs(evidence.change)
    beyond_tolerance = CONFLICT_THRESHOLD * np.hypot(
        evidence.change_sigma, _declared_scale_sigma(evidence, held)
    )
    if change < max(NOTICED_SCALE, CONFLICT_THRESHOLD * evidence.change_sigma) or (
        change < min(UNSURE_FOCAL, beyond_tolerance)
    ):
        return
    causes = _causes(evidence, held)
    if not causes:
        return
    likely = likely_effects(case)
    lacking = any(gain > evidence.gain for _, gain in likely)
    numbers = " and ".join(
        f"{number.name} would be {number.estimated}, declared as {number.stated}"
        for number in causes
    )
    advice = (
        "find what the model lacks first, which may cause it"
        if lacking
        else advice_on(case, [number.name for number in causes], DECLARED)
    )
    yield Reason(
        f"these views contradict numbers that were not fitted: {numbers},"
        f" {change / max(evidence.change_sigma, 1e-12):.0f} standard deviations apart, which"
        f" changes depth and length by {100 * change:.2g} %: {advice}.",
        case.next.diagnose() if lacking else case.next.fit(),
        tuple(number.name for number in causes),
    )


def unconfirmed_numbers(case: Case) -> Iterator[Reason]:
    """Name the numbers that depth and length rest on, if the views do not determine them."""
    evidence = _evidence(case)
    if not evidence or evidence.sigma <= UNSURE_FOCAL:
        return
    names = _dominant(evidence)
    numbers = {number.name: number for number in comparisons(case.calibration)}
    dominant = [numbers[name] for name in names if name in numbers]
    pronoun = "them" if len(dominant) > 1 else "it"
    doubt = "not confirmed by these views"
    purpose = f"confirm {pronoun}"
    if dominant:
        shown = [f"{number.name} ({number.stated})" for number in dominant]
        listed = f"{', '.join(shown[:-1])} and {shown[-1]}" if len(shown) > 1 else shown[0]
        verb = "are" if len(shown) > 1 else "is"
        subject = f"{listed} {verb} taken as {dominant[0].source}"
        if any(number.unknown for number in dominant):
            subject = f"{' and '.join(number.name for number in dominant)} {verb} unknown"
            doubt = "not determined by these views"
            purpose = f"determine {pronoun}"
    else:
        subject = "the lens is taken as declared"
    size = (
        f"more than {100 * UNBOUNDED_SCALE:.0f}"
        if evidence.sigma > UNBOUNDED_SCALE
        else f"{100 * evidence.sigma:.2g}"
    )
    yield Reason(
        f"{subject}, {doubt}: from the views alone, depth and length are uncertain by {size} % (one"
        f" standard deviation). To {purpose}, {POSES}.",
        case.next.capture(),
        tuple(names),
    )


def _evidence(case: Case) -> ScaleEvidence | None:
    """Return what the views say; None where the views themselves gave the intrinsics, whose
    uncertainty `unsure_focal_length` judges.
    """
    if case.calibration.outcome.intrinsics_from == "views":
        return None
    return scale_evidence(case.calibration)


def _held(case: Case) -> dict[str, Comparison]:
    """Return the declared numbers that the fit held without asking the views, by name. Without a
    cover it holds all of them. A fit that gave up its tolerances again has asked.
    """
    calibration = case.calibration
    declared = calibration.declared
    stated = numbers_of(declared.intrinsics, declared.cover)
    estimated = calibration.covariance.size > 0
    free = {param.name for param in case.optimum.model.parameters.free} if estimated else set()
    tried = estimated and AUTO in calibration.request.free
    return {
        number.name: number
        for number in comparisons(calibration)
        if number.name not in free
        and number.source == DECLARED
        and not number.effect
        and (stated[number.name].exact or not tried)
    }


def _declared_scale_sigma(evidence: ScaleEvidence, held: dict[str, Comparison]) -> float:
    """Return the relative uncertainty of the scale by the standard deviations that held numbers are
    declared with.
    """
    square = 0.0
    for name, number in held.items():
        correction = evidence.corrections.get(name)
        if correction and correction.change:
            per_unit = correction.scale_change / (correction.change * number.per_si)
            square += (per_unit * number.tolerance) ** 2
    return float(np.sqrt(square))


def _causes(evidence: ScaleEvidence, held: dict[str, Comparison]) -> list[Comparison]:
    """Return the held numbers that make most of the scale's change, with the views' estimates."""
    changes = {
        name: correction.scale_change * np.sign(evidence.change)
        for name, correction in evidence.corrections.items()
        if name in held
    }
    largest = max(changes.values(), default=0.0)
    return [
        replace(
            held[name],
            estimate=held[name].declared + evidence.corrections[name].change * held[name].per_si,
            sigma=evidence.corrections[name].sigma * held[name].per_si,
        )
        for name, change in changes.items()
        if largest > 0 and change >= DOMINANT * largest
    ]


def _dominant(evidence: ScaleEvidence) -> list[str]:
    """Return the numbers whose groups make at least half of the scale's variance, or else the group
    that makes most of it.
    """
    shares = {name: correction.share for name, correction in evidence.corrections.items()}
    largest = max(shares.values(), default=0.0)
    return [name for name, share in shares.items() if share >= min(DOMINANT, largest)]
