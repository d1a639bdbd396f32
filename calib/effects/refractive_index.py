"""Light bends more or less than stated in the glass, or in what lies outside it."""

from typing import ClassVar

from calib.effects.cover_effect import CoverEffect


class RefractiveIndex(CoverEffect):
    name: ClassVar[str] = "refractive_index"
    description: ClassVar[str] = (
        "Light bends more or less than stated in the glass, or in the medium outside it."
    )
    advice: ClassVar[str] = (
        "measure the glass: views can hardly separate its index from its thickness"
    )
