"""Names for numbers that differ from view to view, in plain words, with advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from calib.effects.board_scale import STRETCH, BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect, EffectContext
from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.free_field import FreeField
from calib.effects.lens import LensEffect
from calib.effects.lens_field import LensField
from calib.effects.varying import SURROUNDINGS, VARYING_NUMBERS
from calib.fitting.declared import PREFIXES
from calib.inference.fitted_model import FittedModel
from calib.inference.naming import MIN_MEMBER_PROBABILITY, NAME_ALONE
from calib.inference.variation import Variation
from calib.inference.variation_equations import VariationEquations
from calib.inference.variation_rows import VariationRows
from calib.inference.varying_numbers import (
    DISTORTION,
    NAMELESS,
    STRUCTURE,
    TWO,
    Group,
    VariationKind,
    first_after_step,
)
from calib.inference.view_variation import find_variations

SHARED: tuple[type[Effect], ...] = (
    LensEffect,
    EntrancePupil,
    LensField,
    BoardShape,
    BoardScale,
    FreeField,
)
"""Causes that all views share."""
EVIDENCE_SCALE = 3.0
"""A difference of this much in log evidence counts as 1 for the probabilities of names: the noise
is not quite normal, the shared causes are linearised, and a lens does not stay in its plane when it
focuses (benchmarks/varies.py).
"""
RELATIVE_SCALE = 0.1
"""The same as a fraction of the gain of the more probable explanation: derivatives by the numbers
are those at declared values, which may be off by tolerances, and are known to a tenth.
"""
VERBS: Mapping[VariationKind, str] = {
    VariationKind.EACH: "differs in every view",
    VariationKind.DRIFT: "drifts with time",
    VariationKind.WARM_UP: "settles in the first views",
    VariationKind.STEP: "changes at",
    VariationKind.ALTERNATING: "alternates from view to view",
    VariationKind.TWO_KINDS: "has two values",
    VariationKind.NEARNESS: "follows the distance of the board",
    VariationKind.TILT: "follows the tilt of the board",
}
SUBJECTS: Mapping[str, str] = {**VARYING_NUMBERS, DISTORTION: "the distortion of the picture"}
"""Plain words for the numbers of a group."""
TWO_OF_THEM: Mapping[str, str] = {
    "focal": "two focus settings or two cameras",
    "principal_point": "two cameras or two modes of the sensor",
    "lens": "two cameras or two lenses",
    "board_flex": "two boards, or one that was turned by half a turn",
    "board_scale": "two boards, or one that was turned by a quarter turn",
}
ADVICE: Mapping[str, str] = {
    "focal": "lock the focus, let the camera warm up, and record again",
    "principal_point": "switch the image stabiliser off, and record again",
    "lens": "keep the pictures of each camera in a session of its own",
    "cover_offset": "fasten the cover, and record again",
    "cover_tilt": "fasten the cover, and record again",
    "cover_radius": "record all views through one cover",
    "thickness": "record all views through one cover",
    "refractive_index": "record all views in the same medium, at one temperature",
    "board_flex": "glue the board to something stiff, and support it in the same way in every view",
    "board_scale": "use one board, on a stiff and dry back",
    "rolling_shutter": "hold the board still, or on a tripod",
    DISTORTION: "see whether the picture is blurred at its edge, lock the focus, and record again",
    STRUCTURE: "lock the focus, hold camera and board still, and record again in good light",
}


@dataclass(frozen=True, slots=True)
class Differing:
    """The numbers that may differ from view to view, the most probable first."""

    variations: tuple[Variation, ...]
    """The most probable kind of each group of numbers."""
    probabilities: tuple[float, ...]
    """That of each variation."""
    names: tuple[str, ...]
    """(V,) the names of the views."""
    is_rest: bool = False
    """True if the model has other numbers that differ. These are hardly ever modelled to the end,
    and any number follows the rest.
    """

    @staticmethod
    def of(
        fitted: FittedModel,
        context: EffectContext,
        *,
        nameless: bool = True,
        about: Group | None = None,
    ) -> Differing | None:
        """Return what differs beside everything that all views share; None if nothing does.

        Args:
            nameless: allow for a discrepancy, an error of each view that has no cause
                (`find_variations`).
            about: the only group that matters; None may mean that it has no name.
        """
        return _answer(_Question(fitted, context, nameless, about))

    @property
    def first(self) -> Variation:
        """The most probable variation."""
        return self.variations[0]

    @property
    def likely(self) -> tuple[Variation, ...]:
        """The most probable variation and its rivals that forbid it to stand alone; none if no
        known cause is the most probable.
        """
        if not self.first.group.has_cause:
            return ()
        rivals = zip(self.variations[1:], self.probabilities[1:], strict=True)
        return (self.first, *(rival for rival, chance in rivals if chance > 1 - NAME_ALONE))

    @property
    def named(self) -> bool:
        """True if one name is almost sure."""
        is_sure = self.probabilities[0] >= NAME_ALONE and not self.is_rest
        return self.first.group.has_cause and is_sure

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of the command contract."""
        return {
            "number": self.first.group.name if self.named else "",
            "kind": str(self.first.kind),
            "size": describe_size(self.first),
            "members": {
                variation.group.name: probability
                for variation, probability in zip(self.variations, self.probabilities, strict=True)
            },
            "sentence": str(self),
        }

    def __str__(self) -> str:
        first = self.first
        if self.named:
            return f"{describe_variation(first, self.names)}: {advice(first, self.names)}."
        if first.group.name == STRUCTURE:
            return (
                "something differs from view to view, and no number of the camera, the cover or the"
                f" board explains it: {advice(first, self.names)}."
            )
        rivals = " or ".join(_subject(variation) for variation in self.variations[1:])
        likely = describe_variation(first, self.names)
        return (
            f"something differs from view to view: most likely {likely}, else"
            f" {rivals or 'nothing that has a name'}. If it is the first,"
            f" {advice(first, self.names)}."
        )


@dataclass(frozen=True, eq=False)
class _Question:
    """A question about an optimum: what differs from view to view? Questions about the same optimum
    are equal: a fit asks for its covariance, and the verdict on it asks again.
    """

    fitted: FittedModel
    context: EffectContext
    nameless: bool
    about: Group | None

    @cached_property
    def _key(self) -> tuple[object, ...]:
        fitted = self.fitted
        names = tuple(effect.name for effect in fitted.model.effects)
        arrays = fitted.deviation, fitted.joint.poses.numpy(), fitted.observations.pixels.numpy()
        content = tuple(array.tobytes() for array in arrays)
        return (
            *content,
            names,
            float(fitted.joint.sigma),
            self.context.shutter,
            self.nameless,
            self.about,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Question) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=1)
def _answer(question: _Question) -> Differing | None:
    """Return the most probable variation of each group, with its probability; None if there is no
    variation.
    """
    fitted = question.fitted
    variations = find_variations(
        fitted, question.context, SHARED, nameless=question.nameless, about=question.about
    )
    best_of_group: dict[str, Variation] = {}
    for variation in variations:  # the most probable first
        best_of_group.setdefault(variation.group.name, variation)
    if not best_of_group:
        return None
    candidates = list(best_of_group.values())
    odds = np.array([_odds(variation, candidates[0]) for variation in candidates])
    probabilities = odds / odds.sum()
    likely = np.flatnonzero(probabilities > MIN_MEMBER_PROBABILITY)
    return Differing(
        variations=tuple(candidates[index] for index in likely),
        probabilities=tuple(float(probabilities[index]) for index in likely),
        names=fitted.observations.names,
        is_rest=any(effect.varies or effect.per_view for effect in fitted.model.effects),
    )


def possible_shifts(fitted: FittedModel, context: EffectContext) -> NDArray[np.float64]:
    """Return (S, S) the covariance of the shifts of the fitted parameters by what seems to differ
    from view to view: of each number that may differ, by its probability. It is zero where nothing
    does.
    """
    count = fitted.parameters().count
    covariance = np.zeros((count, count))
    if differing := Differing.of(fitted, context):
        equations = VariationEquations.of(VariationRows.of(fitted, context))
        for variation, chance in zip(differing.variations, differing.probabilities, strict=True):
            if variation.group.name != STRUCTURE:
                shift = equations.shift(variation)
                covariance += chance * np.outer(shift, shift)
    return covariance


def _odds(variation: Variation, best: Variation) -> float:
    """Return the odds of a variation against the most probable one: those of their evidences or, if
    these are less decisive, those of Vuong's test, which asks whether the views agree.
    """
    if variation is best:
        return 1.0
    lead = best.gain - variation.gain
    ratios = best.view_log_likelihoods - variation.view_log_likelihoods
    p_value = float(ndtr(-lead / (ratios.std(ddof=1) * len(ratios) ** 0.5)))
    return max(float(np.exp(-lead / evidence_scale(best.gain))), p_value / (1 - p_value))


def evidence_scale(gain: float) -> float:
    """Return the difference in log evidence that counts as 1 beside what differs from view to view.

    Args:
        gain: the increase of the log evidence by the more probable explanation.
    """
    return max(EVIDENCE_SCALE, RELATIVE_SCALE * gain)


def describe_variation(variation: Variation, names: Sequence[str]) -> str:
    """Return what differs, how, and by how much, as a clause."""
    verb = VERBS[variation.kind]
    if variation.kind is VariationKind.STEP:
        verb += f" {names[first_after_step(variation.pattern)]}"
    clause = f"{_subject(variation)} {verb}"
    if variation.group.is_medium:
        return f"{clause} (air and water)"
    if variation.kind in TWO and variation.group.name in TWO_OF_THEM:
        clause += f" ({TWO_OF_THEM[variation.group.name]})"
    size = describe_size(variation)
    return f"{clause}, by {size}" if size else clause


def _subject(variation: Variation) -> str:
    """Return plain words for what differs."""
    return SURROUNDINGS if variation.group.is_medium else SUBJECTS[variation.group.name]


def describe_size(variation: Variation) -> str:
    """Return the root mean square of the deviations of the number that deviates most: over its
    tolerance, if the numbers have different units. The text is empty for a motion, a whole lens,
    and what has no name.
    """
    if variation.group.name in ("lens", "rolling_shutter", *NAMELESS):
        return ""
    numbers = variation.group.numbers
    rms = np.sqrt((variation.deviations**2).mean(0))
    sizes = rms * [number.sigma for number in numbers]
    has_one_unit = len({number.param.unit for number in numbers}) == 1
    index = int((sizes if has_one_unit else rms).argmax())
    number, size = numbers[index], float(sizes[index])
    if number.relative or number.param is STRETCH.param:
        return f"{100 * size:.2g} %"
    unit, factor = PREFIXES.get(number.param.unit, (number.param.unit, 1.0))
    return f"{factor * size:.2g} {unit}".rstrip()


def advice(variation: Variation, names: Sequence[str]) -> str:
    """Return what to do, as a clause."""
    name = variation.group.name
    if variation.group.is_medium:
        return "keep the pictures in air and those in water in sessions of their own"
    if variation.kind is VariationKind.STEP and name.startswith(("cover", "focal", "principal")):
        return f"calibrate from {names[first_after_step(variation.pattern)]} on, or record again"
    if variation.kind in TWO and name in TWO_OF_THEM:
        return "keep the pictures of each kind in a session of its own"
    if variation.kind is VariationKind.NEARNESS:
        return "the lens focuses by itself: lock the focus, and record again"
    if variation.kind is VariationKind.TILT:
        return "it bends by its own weight: support it, or take a stiffer one"
    return ADVICE[name]
