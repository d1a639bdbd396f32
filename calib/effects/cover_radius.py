"""The cover is wider or narrower than stated, or its taper is different."""

from typing import ClassVar

from calib.effects.cover_effect import CoverEffect


class CoverRadius(CoverEffect):
    name: ClassVar[str] = "cover_radius"
    description: ClassVar[str] = (
        "The cover is wider or narrower than stated, or its taper is different."
    )
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"
