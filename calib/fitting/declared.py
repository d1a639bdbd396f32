"""Compare the numbers that a session declares with their estimates: each with its tolerance, and
with the increments of effects added.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from calib.calibration import Calibration
from calib.effects.effect import EffectParameter
from calib.estimation.prior_conflict import CONFLICT_THRESHOLD, MIN_SPREAD
from calib.rounding import to_digit_of, with_sigma
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.deviation import independent_deviation, normalised_deviation
from calib.session.parameter_names import CAMERA
from calib.session.schema import UNKNOWN, Number, Quantity

UNITS = {"millimetres": "mm", "degrees": "deg"}
"""Abbreviation of a unit that is shown after a number."""
PREFIXES = {"m": ("mm", 1e3), "rad": ("mrad", 1e3)}
"""The unit that people read instead of an SI unit, and how many of it make one SI unit."""
OPEN = 0.5
"""The standard deviation of an unknown number over that of its wide prior, above which the views do
not tell the number.
"""
UNINFORMED = 0.9
"""The standard deviation of a declared number over its tolerance, above which the views hardly add
to it.
"""
UNUSUAL = 4.0
"""Standard deviations of the wide prior from its mean, twice the stated range, from where on an
estimate is not what such numbers are.
"""
MIN_CORRECTION = 3.0
"""Standard deviations of the estimate: a nearer declared value is as good as the estimate."""


DECLARED, BARE, VIEWS = "declared", "found in bare/", "found by the views alone"
"""The sources of a number's prior."""
ANY_SHAPE, EITHER_LENS = "any shape", "either lens"
"""Words for a sigma over several explanations of the views."""
SOURCES = {"bare": BARE, "views": VIEWS}
"""The source of intrinsics by `intrinsics_from` of the outcome; all other numbers are declared."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One declared number and its estimate, in the unit of session.yaml.

    The estimate includes the increment of an effect that shifts this number.
    """

    name: str
    unit: str
    declared: float
    tolerance: float
    """Standard deviation of the prior; 0 if the fit held the number."""
    estimate: float
    sigma: float
    effect: str = ""
    """The effect that estimates the number or its increment; empty if only the fit does."""
    doubted: bool = False
    """True if the fit widened the tolerance because the views contradict it."""
    source: str = DECLARED
    per_si: float = 1.0
    """Factor from the SI unit to `unit`."""
    unknown: bool = False
    """True if nobody knows the number: `declared` and `tolerance` are its wide prior."""
    alternatives: str = ""
    """ANY_SHAPE if `sigma` is for all of the cover's shapes that explain the views as well,
    EITHER_LENS if it is for two lenses; empty if there is one explanation.
    """

    @property
    def held(self) -> bool:
        return not self.tolerance

    @property
    def normalised_deviation(self) -> float:
        """Return the distance between estimate and declared value, in standard deviations of that
        distance (`calib.session.deviation`). The estimate of a doubted number is independent of the
        declared value.
        """
        distance = self.estimate - self.declared
        if self.doubted:
            return abs(independent_deviation(distance, self.tolerance, self.sigma))
        return abs(
            float(normalised_deviation(distance, self.tolerance, self.sigma, min_spread=MIN_SPREAD))
        )

    @property
    def contradicted(self) -> bool:
        """True if the views and the declared value contradict each other."""
        if self.unknown:
            return False
        return self.doubted or self.normalised_deviation > CONFLICT_THRESHOLD

    @property
    def corrected(self) -> bool:
        """True if the views distinguish the estimate from the declared value."""
        if self.held or self.unknown:
            return False
        return abs(self.estimate - self.declared) > MIN_CORRECTION * self.sigma

    @property
    def is_unusual(self) -> bool:
        """True if the number is unknown and its estimate is far outside of its stated range."""
        return self.unknown and abs(self.estimate - self.declared) > UNUSUAL * self.tolerance

    @property
    def is_open(self) -> bool:
        """True if the number is unknown and the views do not tell it."""
        return self.unknown and self.sigma > OPEN * self.tolerance

    @property
    def is_uninformed(self) -> bool:
        """True if the number is declared and the views hardly add to it."""
        is_declared = self.source == DECLARED and not (self.held or self.unknown)
        return is_declared and self.sigma > UNINFORMED * self.tolerance

    def __str__(self) -> str:
        if self.source == VIEWS:
            return f"{self.name} {self.estimated}"
        return f"{self.name} {self.estimated}, {self.source} as {self.stated}"

    @property
    def stated(self) -> str:
        """Return the declared value with tolerance and unit, as text."""
        if self.unknown:
            return UNKNOWN
        value = (
            with_sigma(self.declared, self.tolerance) if self.tolerance else f"{self.declared:.6g}"
        )
        return f"{value} {self.unit}".rstrip()

    @property
    def estimated(self) -> str:
        """Return the estimate with sigma and unit, as text."""
        return f"{with_sigma(self.estimate, self.sigma)} {self.unit}".rstrip()

    @property
    def summed(self) -> str:
        """Return the estimate as the sum of declared value and increment, as text."""
        if self.unknown:
            return f"{self.name} {self.estimated}"
        if self.sigma > 0:
            number = to_digit_of(self.estimate, self.sigma)
        else:
            number = f"{self.estimate:.5g}"
        value = f"{number} {self.unit}".rstrip()
        increment = self.estimate - self.declared
        sign = "-" if increment < 0 else "+"
        return (
            f"{self.name} {value} = {self.declared:.6g} {self.source} {sign}"
            f" {with_sigma(abs(increment), self.sigma)}"
        )


def comparisons(calibration: Calibration) -> Iterator[Comparison]:
    """Yield every number of the cover and of the intrinsics, in the order of session.yaml."""
    increments = {
        name: scalar for scalar in _scalars(calibration) for name in scalar.parameter.shifts
    }
    outcome = calibration.outcome
    shapes = outcome.shape_camera_sigma or {}
    alternatives = EITHER_LENS if outcome.rival_lens else ANY_SHAPE
    for row in _declared(calibration):
        number = increments[row.name].add_to(row) if row.name in increments else row
        if (sigma := shapes.get(number.name, 0.0)) > number.sigma:
            number = replace(number, sigma=sigma, alternatives=alternatives)
        yield number


def effect_comparisons(calibration: Calibration) -> Iterator[Comparison]:
    """Yield the scalar parameters of effects that are no increment of a declared number.

    The mean of a parameter's prior takes the place of the declared value.
    """
    declared = {row.name for row in _declared(calibration)}
    for scalar in _scalars(calibration):
        if not declared & set(scalar.parameter.shifts):
            param = scalar.parameter.param
            unit, per_si = PREFIXES.get(param.unit, (param.unit, 1.0))
            yield Comparison(
                param.name,
                unit,
                scalar.parameter.initial * per_si,
                scalar.parameter.sigma * per_si,
                scalar.value * per_si,
                scalar.sigma * per_si,
                scalar.effect,
            )


@dataclass(frozen=True, slots=True)
class _Scalar:
    """A scalar parameter of an effect, in SI units."""

    effect: str
    parameter: EffectParameter
    value: float
    sigma: float

    def add_to(self, number: Comparison) -> Comparison:
        """Return a declared number with this increment added."""
        unit = number.estimate if self.parameter.relative else number.per_si
        return Comparison(
            name=number.name,
            unit=number.unit,
            declared=number.declared,
            tolerance=math.hypot(number.tolerance, self.parameter.sigma * abs(unit)),
            estimate=number.estimate + self.value * unit,
            sigma=math.hypot(number.sigma, self.sigma * abs(unit)),
            effect=self.effect,
            doubted=number.doubted,
            source=number.source,
            per_si=number.per_si,
            unknown=number.unknown,
        )


def _scalars(calibration: Calibration) -> Iterator[_Scalar]:
    for added in calibration.effects:
        for parameter in added.effect.effect_parameters:
            value, sigma = added.parameters[parameter.param.name]
            if not value.ndim:
                yield _Scalar(added.effect.name, parameter, float(value), float(sigma))


def _declared(calibration: Calibration) -> Iterator[Comparison]:
    """Yield every declared number with the fit's estimate, without the effects' increments."""
    declared, cover, camera = calibration.declared, calibration.cover, calibration.camera.intrinsics
    assert camera

    lens = SOURCES.get(calibration.outcome.intrinsics_from or "", DECLARED)

    def compare(
        quantity: Quantity, name: str, prior: Number, estimate: Number, source: str = DECLARED
    ) -> Comparison:
        unit, per_si = ("px", 1.0) if quantity in PINHOLE else quantity.unit
        return Comparison(
            name=name,
            unit=UNITS.get(unit, unit),
            declared=prior.value * per_si,
            tolerance=prior.sigma * per_si,
            estimate=estimate.value * per_si,
            sigma=estimate.sigma * per_si,
            doubted=name in declared.doubted,
            source=source,
            per_si=per_si,
            unknown=prior.unknown,
        )

    priors, estimates = declared.cover.numbers, cover.numbers
    for name, dimension in cover.dimensions.items():
        yield compare(dimension.quantity, name, priors[name], estimates[name])
    for quantity in PINHOLE:
        prior, estimate = getattr(declared.intrinsics, quantity.key), getattr(camera, quantity.key)
        yield compare(quantity, CAMERA.of(quantity.key), prior, estimate, lens)
    for name, prior, estimate in zip(
        camera.names, declared.intrinsics.distortion, camera.distortion, strict=False
    ):
        if prior.value or prior.sigma or estimate.sigma:
            yield compare(COEFFICIENT, CAMERA.of(name), prior, estimate, lens)
