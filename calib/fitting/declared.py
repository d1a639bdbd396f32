"""What the session declares against what the views say: every number of camera and cover with its tolerance, and its estimate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from calib.calibration import Calibration
from calib.optics.lens_model import COEFFICIENTS
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.cover import SHAPES
from calib.session.schema import Number, Quantity

UNITS = {"millimetres": "mm", "degrees": "deg"}
"""As they are shown beside a figure."""
CONTRADICTED = 3.0
"""Standard deviations: the farthest of a number that is what it is declared to be, in one of 370."""
CORRECTED = 3.0
"""Of the estimate's own standard deviations: nearer, the declared value is as good."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One number, in the unit that session.yaml writes it in."""

    name: str
    unit: str
    declared: float
    tolerance: float
    """Standard deviation of the prior; 0 where it was held."""
    estimate: float
    sigma: float

    @property
    def held(self) -> bool:
        return not self.tolerance

    @property
    def apart(self) -> float:
        """How far the estimate is from what is declared, in standard deviations of what the prior lets that distance be.

        If the true number is drawn from the prior, the variance of estimate - declared is the prior's less the posterior's.
        """
        variance = self.tolerance**2 - self.sigma**2
        return abs(self.estimate - self.declared) / variance**0.5 if variance > 0 else 0.0

    @property
    def contradicted(self) -> bool:
        """Whether the views and what is declared cannot both be right."""
        return self.apart > CONTRADICTED

    @property
    def corrected(self) -> bool:
        """Whether the views tell the number from what is declared."""
        return not self.held and abs(self.estimate - self.declared) > CORRECTED * self.sigma

    def __str__(self) -> str:
        return f"{self.name} {self._with_unit(self.estimate, self.sigma)}, declared as {self._with_unit(self.declared, self.tolerance)}"

    def _with_unit(self, value: float, sigma: float) -> str:
        return f"{value:.5g} ± {sigma:.2g} {self.unit}".rstrip()


def comparisons(calibration: Calibration) -> Iterator[Comparison]:
    """Every number of the cover and of the intrinsics, in the order in which a session writes them."""
    declared, cover, camera = calibration.declared, calibration.cover, calibration.camera.intrinsics
    assert camera
    for quantity in SHAPES[cover.shape]:
        for name in quantity.names:
            yield _compared(quantity, f"cover.{name}", declared.cover.parameters[name], cover.parameters[name])
    for quantity, name in zip(PINHOLE, ("fx", "fy", "cx", "cy"), strict=True):
        yield _compared(quantity, f"camera.{name}", getattr(declared.intrinsics, name), getattr(camera, name))
    for name, number, found in zip(COEFFICIENTS, declared.intrinsics.distortion, camera.distortion, strict=False):
        if number.value or number.sigma or found.sigma:
            yield _compared(COEFFICIENT, f"camera.{name}", number, found)


def _compared(quantity: Quantity, name: str, declared: Number, found: Number) -> Comparison:
    unit, per_si = ("px", 1.0) if quantity in PINHOLE else quantity.unit
    figures = (declared.value, declared.sigma, found.value, found.sigma)
    return Comparison(name, UNITS.get(unit, unit), *(figure * per_si for figure in figures))
