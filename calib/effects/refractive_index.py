"""The glass, or what lies outside it, bends light more or less than stated."""

from typing import ClassVar

from calib.effects.cover_numbers import CoverNumber


class RefractiveIndex(CoverNumber):
    name: ClassVar[str] = "refractive_index"
    candidates: ClassVar[dict[str, tuple[str, float, float]]] = {"cover.refractive_index": ("", 1e-2, 0.03)}
