"""The cover stands elsewhere than stated: its axis, its centre, or its distance."""

from typing import ClassVar

from calib.effects.cover_numbers import METRE, CoverNumber


class CoverOffset(CoverNumber):
    name: ClassVar[str] = "cover_offset"
    candidates: ClassVar[dict[str, tuple[str, float, float]]] = {
        "cover.axis_offset.x": METRE,
        "cover.axis_offset.z": METRE,
        "cover.centre.x": METRE,
        "cover.centre.y": METRE,
        "cover.centre.z": METRE,
        "cover.distance": METRE,
    }
