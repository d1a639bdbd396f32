"""The glass is thicker or thinner than stated."""

from typing import ClassVar

from calib.effects.cover_numbers import CoverNumber


class Thickness(CoverNumber):
    name: ClassVar[str] = "thickness"
    candidates: ClassVar[dict[str, tuple[str, float, float]]] = {"cover.thickness": ("m", 1e-3, 5e-4)}
