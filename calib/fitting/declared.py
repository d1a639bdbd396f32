"""What the session declares against what the views say: every number with its tolerance, and its
estimate, effects' increments added.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from calib.calibration import Calibration
from calib.effects.effect import EffectParameter
from calib.estimation.prior_conflict import (
    CONFLICT_THRESHOLD,
    independent_deviation,
    normalised_deviation,
)
from calib.fitting.rounding import to_digit_of, with_sigma
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.cover import SHAPES
from calib.session.schema import Number, Quantity

UNITS = {"millimetres": "mm", "degrees": "deg"}
"""As they are shown beside a figure."""
PREFIXES = {"m": ("mm", 1e3), "rad": ("mrad", 1e3)}
"""Units of effects' own parameters as people read them, where they are others, and how many make
one.
"""
CORRECTED = 3.0
"""Of the estimate's own standard deviations: nearer, the declared value is as good."""


DECLARED, BARE, VIEWS = "declared", "found in bare/", "found by the views alone"
"""How a number was known before the fit."""
FROM = {"bare": BARE, "views": VIEWS}
"""Intrinsics, by `intrinsics_from` of a calibration's settings; all others are declared."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One number, in the unit that session.yaml writes it in: with an effect that is an increment
    of it, their sum.
    """

    name: str
    unit: str
    declared: float
    tolerance: float
    """Standard deviation of the prior; 0 where it was held."""
    estimate: float
    sigma: float
    effect: str = ""
    """The effect that estimates it, or its increment; empty: the fit itself."""
    doubted: bool = False
    """Whether the fit gave up the tolerance, since the views contradict it."""
    source: str = DECLARED
    per_si: float = 1.0
    """How many of the unit make one SI unit."""

    @property
    def held(self) -> bool:
        return not self.tolerance

    @property
    def normalised_deviation(self) -> float:
        """How far the estimate is from what is declared, in standard deviations of what that
        distance may be: see `calib.estimation.prior_conflict`. An estimate that owes nothing to
        what is declared has a variance of its own.
        """
        distance = self.estimate - self.declared
        return (independent_deviation if self.doubted else normalised_deviation)(
            distance, self.tolerance, self.sigma
        )

    @property
    def contradicted(self) -> bool:
        """Whether the views and what is declared cannot both be right."""
        return self.doubted or self.normalised_deviation > CONFLICT_THRESHOLD

    @property
    def corrected(self) -> bool:
        """Whether the views tell the number from what is declared."""
        return not self.held and abs(self.estimate - self.declared) > CORRECTED * self.sigma

    def __str__(self) -> str:
        return f"{self.name} {self.estimated}, {self.source} as {self.stated}"

    @property
    def stated(self) -> str:
        """What was known of it, for people."""
        tolerance = f" ± {self.tolerance:.2g}" if self.tolerance else ""
        return f"{self.declared:.6g}{tolerance} {self.unit}".rstrip()

    @property
    def estimated(self) -> str:
        """What is estimated, for people."""
        return f"{with_sigma(self.estimate, self.sigma)} {self.unit}".rstrip()

    @property
    def summed(self) -> str:
        """The estimate as what is declared and the effect's increment."""
        value = (
            f"{to_digit_of(self.estimate, self.sigma) if self.sigma > 0 else f'{self.estimate:.5g}'}"  # noqa: E501
            f" {self.unit}".rstrip()
        )
        increment = self.estimate - self.declared
        sign = "-" if increment < 0 else "+"
        return (
            f"{self.name} {value} = {self.declared:.6g} {self.source} {sign}"
            f" {with_sigma(abs(increment), self.sigma)}"
        )


def comparisons(calibration: Calibration) -> Iterator[Comparison]:
    """Every number of the cover and of the intrinsics, in the order in which a session writes
    them.
    """
    increments = {name: added for added in _scalars(calibration) for name in added.unknown.shifts}
    for one in _declared(calibration):
        yield increments[one.name].onto(one) if one.name in increments else one


def own_parameters(calibration: Calibration) -> Iterator[Comparison]:
    """The effects' scalars that are no increment of a declared number.

    What they are supposed to be stands for what is declared.
    """
    declared = {one.name for one in _declared(calibration)}
    for added in _scalars(calibration):
        if not declared & set(added.unknown.shifts):
            param = added.unknown.param
            unit, per_si = PREFIXES.get(param.unit, (param.unit, 1.0))
            supposed, tolerance = added.unknown.initial * per_si, added.unknown.sigma * per_si
            yield Comparison(
                param.name,
                unit,
                supposed,
                tolerance,
                added.value * per_si,
                added.sigma * per_si,
                added.effect,
            )


@dataclass(frozen=True, slots=True)
class _Scalar:
    """A scalar parameter of an effect, in SI units."""

    effect: str
    unknown: EffectParameter
    value: float
    sigma: float

    def onto(self, one: Comparison) -> Comparison:
        """A declared number with this increment."""
        unit = one.estimate if self.unknown.relative else one.per_si
        return Comparison(
            name=one.name,
            unit=one.unit,
            declared=one.declared,
            tolerance=math.hypot(one.tolerance, self.unknown.sigma * abs(unit)),
            estimate=one.estimate + self.value * unit,
            sigma=math.hypot(one.sigma, self.sigma * abs(unit)),
            effect=self.effect,
            doubted=one.doubted,
            source=one.source,
            per_si=one.per_si,
        )


def _scalars(calibration: Calibration) -> Iterator[_Scalar]:
    for added in calibration.effects:
        for unknown in added.effect.effect_parameters:
            value, sigma = added.parameters[unknown.param.name]
            if not value.ndim:
                yield _Scalar(added.effect.name, unknown, float(value), float(sigma))


def _declared(calibration: Calibration) -> Iterator[Comparison]:
    """Yield every declared number with the fit's estimate, without the effects' increments."""
    declared, cover, camera = calibration.declared, calibration.cover, calibration.camera.intrinsics
    assert camera

    lens = FROM.get(calibration.settings.get("intrinsics_from", ""), DECLARED)

    def compared(
        quantity: Quantity, name: str, said: Number, found: Number, source: str = DECLARED
    ) -> Comparison:
        unit, per_si = ("px", 1.0) if quantity in PINHOLE else quantity.unit
        return Comparison(
            name=name,
            unit=UNITS.get(unit, unit),
            declared=said.value * per_si,
            tolerance=said.sigma * per_si,
            estimate=found.value * per_si,
            sigma=found.sigma * per_si,
            doubted=name in declared.doubted,
            source=source,
            per_si=per_si,
        )

    for quantity in SHAPES[cover.shape]:
        for name in quantity.names:
            yield compared(
                quantity, f"cover.{name}", declared.cover.parameters[name], cover.parameters[name]
            )
    for quantity, name in zip(PINHOLE, ("fx", "fy", "cx", "cy"), strict=True):
        yield compared(
            quantity,
            f"camera.{name}",
            getattr(declared.intrinsics, name),
            getattr(camera, name),
            lens,
        )
    for name, number, found in zip(
        camera.names, declared.intrinsics.distortion, camera.distortion, strict=False
    ):
        if number.value or number.sigma or found.sigma:
            yield compared(COEFFICIENT, f"camera.{name}", number, found, lens)
