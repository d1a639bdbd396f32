"""The cover is wider or narrower than stated, or tapers otherwise."""

from typing import ClassVar

from calib.effects.cover_numbers import METRE, SLOPE, CoverNumber


class CoverRadius(CoverNumber):
    name: ClassVar[str] = "cover_radius"
    candidates: ClassVar[dict[str, tuple[str, float, float]]] = {"cover.inner_radius": METRE, "cover.radius_slope": SLOPE}
