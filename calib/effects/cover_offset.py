"""The cover is not where the session places it: its axis, its centre, or its distance."""

from typing import ClassVar

from calib.effects.cover_effect import CoverEffect


class CoverOffset(CoverEffect):
    name: ClassVar[str] = "cover_offset"
    description: ClassVar[str] = "The cover is not where the session places it."
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"
