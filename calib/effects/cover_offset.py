"""The cover is not where the session places it: its axis, its centre, or its distance."""

from typing import ClassVar

from calib.effects.cover_effect import CoverEffect
from calib.session.tolerances import DISTANCE, OFFSET, Tolerance


class CoverOffset(CoverEffect):
    name: ClassVar[str] = "cover_offset"
    description: ClassVar[str] = "The cover is not where the session places it."
    advice: ClassVar[str] = "hold the board as near as it fits into the picture"
    candidates: ClassVar[dict[str, Tolerance]] = {
        "cover.axis_offset.x": OFFSET,
        "cover.axis_offset.z": OFFSET,
        "cover.centre.x": OFFSET,
        "cover.centre.y": OFFSET,
        "cover.centre.z": OFFSET,
        "cover.distance": DISTANCE,
    }
