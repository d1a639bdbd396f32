"""The glass is thicker or thinner than stated."""

from typing import ClassVar

from calib.effects.cover_effect import CoverEffect


class Thickness(CoverEffect):
    name: ClassVar[str] = "thickness"
    description: ClassVar[str] = "The glass is thicker or thinner than stated."
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"
