"""The words of a rig's diagnosis: what was found, with its size, and what the placements leave
open.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from calib.diagnosis.finding import ParameterEstimate
from calib.effects.effect import EACH_VIEW
from calib.optics.board_polynomials import bend_sigma, term_name
from calib.optics.flex_bend import FLEX_TERMS
from calib.rig.board_motion import MAX_INTERVAL, MIN_BURST
from calib.rig.check_words import size_and_sigma
from calib.rig.explanation_fit import FittedExplanation
from calib.rig.moved_cameras import KINDS
from calib.rig.rig_content import FoundEffect
from calib.rig.rig_context import RigContext
from calib.rig.rig_effects import (
    BOARD_FLEX,
    LATENESS,
    RIG_FLEX,
    RIG_SLIP,
    ROLLING_SHUTTER,
    SYNC_OFFSET,
)
from calib.rounding import with_sigma
from calib.session.tolerances import BOARD_FLEX as BOARD_BEND

UNTIMED = (
    "Whether a camera exposes later by a constant time cannot be told:"
    f" no {MIN_BURST} placements in a row are within {MAX_INTERVAL:g} s of each other by time_s in"
    " frames.csv. Record bursts of a moving board."
)
MAX_SIGMAS = 3.0
"""A lateness may be larger than the fit states by so many standard deviations."""

Array = NDArray[np.float64]


def parameters_of(fitted: FittedExplanation) -> dict[str, ParameterEstimate]:
    """Return the numbers of an explanation, with their standard deviations."""
    explanation = fitted.explanation
    name = explanation.name
    if explanation.own_effect and fitted.estimate:
        unknowns = explanation.own_effect.effect.effect_parameters
        sigmas = np.sqrt(fitted.estimate.covariance.diagonal())
        return {
            unknown.param.name: ParameterEstimate(
                float(value) * unknown.param.scale,
                float(sigma) * unknown.param.scale,
                unknown.param.unit,
            )
            for unknown, value, sigma in zip(unknowns, fitted.estimate.value, sigmas, strict=False)
        }
    if explanation.is_late and fitted.estimate:
        sigma = float(fitted.estimate.covariance[0, 0] ** 0.5)
        value = float(fitted.estimate.value[0])
        if is_undetermined(fitted):
            sigma = max(sigma, explanation.interval_s, abs(value))
        return {f"{name}.late": ParameterEstimate(value, sigma, "s")}
    if explanation.is_of_bends:
        # Before a fit has the bends: the standard deviations of their prior.
        scale, certainty = float(fitted.sizes[0]), float(fitted.size_sigmas[0] / fitted.sizes[0])
        sizes = [scale * bend_sigma(BOARD_BEND.sigma, term) for term in FLEX_TERMS]
        return _bend_parameters(sizes, certainty)
    if explanation.varies == EACH_VIEW:
        numbers = ("turn", "rad"), ("shift", "m")
        return {
            f"{name}.{number_name}": ParameterEstimate(float(size), float(sigma), unit)
            for (number_name, unit), size, sigma in zip(
                numbers, fitted.sizes, fitted.size_sigmas, strict=False
            )
        }
    if fitted.estimate:
        axes = [f"{number_name}.{axis}" for number_name in ("turn", "shift") for axis in "xyz"]
        units = ["rad"] * 3 + ["m"] * 3
        chosen = KINDS[explanation.kind]
        # The camera goes the other way than everything outside.
        return {
            f"{name}.{axis}": ParameterEstimate(-float(value), float(sigma), unit)
            for axis, unit, value, sigma in zip(
                axes[chosen],
                units[chosen],
                fitted.estimate.value,
                np.sqrt(fitted.estimate.covariance.diagonal()),
                strict=True,
            )
        }
    return {}


def bend_parameters(bends: Array) -> dict[str, ParameterEstimate]:
    """Return the root mean square of each term of (P, 12) m bends of the board, with the standard
    deviation that as many normal numbers have.
    """
    sizes = np.sqrt((bends**2).mean(0)).tolist()
    return _bend_parameters(sizes, (2 * len(bends)) ** -0.5)


def _bend_parameters(sizes: Sequence[float], certainty: float) -> dict[str, ParameterEstimate]:
    return {
        f"{BOARD_FLEX.name}.{term_name(term)}": ParameterEstimate(size, certainty * size, "m")
        for term, size in zip(FLEX_TERMS, sizes, strict=True)
    }


def is_undetermined(fitted: FittedExplanation) -> bool:
    """Return True for a lateness that may be above half of the interval between the placements of a
    burst: the fit cannot tell its size from a shift by whole intervals.
    """
    if not fitted.explanation.is_late or not fitted.estimate:
        return False
    sigma = float(fitted.estimate.covariance[0, 0] ** 0.5)
    largest = abs(float(fitted.estimate.value[0])) + MAX_SIGMAS * sigma
    return largest > fitted.explanation.interval_s / 2


def describe_found(effect: FoundEffect, fitted: FittedExplanation, partner: str) -> str:
    """Return what was found, as a sentence without a full stop.

    Args:
        partner: the other camera of a pair; empty for more cameras.
    """
    camera = effect.camera
    partners = partner or "the others"
    numbers = effect.parameters
    if effect.effect == SYNC_OFFSET.name and not effect.varies:
        late = numbers[f"{effect.effect}.late"]
        word = "later" if late.value > 0 else "earlier"
        if is_undetermined(fitted):
            interval_ms = 1e3 * fitted.explanation.interval_s
            return (
                f"{camera} exposes {word} than {partners} by about half of the"
                f" {interval_ms:.0f} ms between the pictures of a burst, or more, and the size of"
                " such a delay cannot be told from a shift by whole pictures"
            )
        size = with_sigma(1e3 * abs(late.value), 1e3 * late.sigma)
        return f"{camera} exposes {size} ms {word} than {partners}"
    if effect.effect == SYNC_OFFSET.name:
        return (
            f"the board moves between the exposures of {camera} and {partners}, by"
            f" {_sizes(effect)} in each number of its pose"
        )
    if effect.effect == BOARD_FLEX.name:
        length = np.sqrt(sum(number.value**2 for number in numbers.values()))
        return (
            "the board bends differently in every placement, by"
            f" {1e3 * length:.2g} mm (root mean square over placements and terms)"
        )
    if effect.effect == ROLLING_SHUTTER.name:
        return (
            f"the board moves while a picture of {fitted.explanation.subject} is read out, by"
            f" {_sizes(effect)} about and along each axis"
        )
    if effect.effect == RIG_FLEX.name:
        return (
            f"the mounting of {camera} against {partners} differs from placement to placement, by"
            f" {_sizes(effect)} about and along each axis"
        )
    assert effect.effect == RIG_SLIP.name
    return f"{camera} slipped before {effect.from_file}: it {_slip(fitted)} against {partners}"


def open_questions(context: RigContext) -> Iterator[str]:
    """Yield sentences on what these placements cannot tell."""
    if not context.motion.bursts:
        yield UNTIMED
    missing = [name for name in context.compared if name not in context.mounted]
    if missing:
        yield (
            f"Whether the mounting of {' and '.join(missing)} flexes or slipped is not asked: a"
            " camera behind a shared cover does not tell its motion from that of the cover."
        )


def describe_own(fitted: FittedExplanation, camera: str) -> str:
    """Return a sentence on an effect of a camera or of the board that explains most.

    Args:
        camera: one whose own diagnosis may fit it.
    """
    explanation = fitted.explanation
    assert explanation.effect
    subject = f"of {explanation.camera}" if explanation.camera else "of the board"
    return (
        f"Most probable is an effect {subject}, not of the rig: {explanation.name}."
        f" {explanation.effect.description} calib diagnose of the folder of {camera} fits it."
    )


def describe_lateness(fitted: FittedExplanation) -> str:
    """Return a sentence on a lateness that was not found."""
    assert fitted.estimate
    sigma = float(fitted.estimate.covariance[0, 0] ** 0.5)
    camera = fitted.explanation.camera
    if sigma > LATENESS.sigma / 2:
        return (
            f"Whether {camera} exposes later by a constant time cannot be told: the board hardly"
            " moves in the bursts. Move it faster."
        )
    if is_undetermined(fitted):
        return (
            f"Whether {camera} exposes later by a constant time cannot be told: a delay above half"
            " of the interval between the pictures of a burst looks like a shift by whole pictures."
        )
    value = with_sigma(1e3 * float(fitted.estimate.value[0]), 1e3 * sigma)
    return f"{camera} exposes {value} ms later than the others, which is no more than chance."


def _sizes(effect: FoundEffect) -> str:
    turn = effect.parameters[f"{effect.effect}.turn"]
    shift = effect.parameters[f"{effect.effect}.shift"]
    degrees = with_sigma(np.degrees(turn.value), np.degrees(turn.sigma))
    return f"{degrees} degrees and {with_sigma(1e3 * shift.value, 1e3 * shift.sigma)} mm"


def _slip(fitted: FittedExplanation) -> str:
    assert fitted.estimate
    value, covariance = fitted.estimate.value, fitted.estimate.covariance
    kind = fitted.explanation.kind
    words = []
    if kind != "moved":
        turn = size_and_sigma(value[:3], covariance[:3, :3])
        words.append(f"turned by {with_sigma(*np.degrees(turn).tolist())} degrees")
    if kind != "turned":
        shift = size_and_sigma(value[-3:], covariance[-3:, -3:])
        words.append(f"moved by {with_sigma(1e3 * shift[0], 1e3 * shift[1])} mm")
    return " and ".join(words)
