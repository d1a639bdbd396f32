"""Numbers that differ from view to view: they follow a pattern over the views, or every view has
its own.

An effect of this kind has the name of the numbers: focal, principal_point, lens, or that of the
effect on a number of the cover. `varies` says how they differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.effect import EACH_VIEW, Effect, EffectContext, EffectParameter
from calib.effects.lens import brown_shift
from calib.effects.view_effect import ViewEffect
from calib.optics.exposure import Exposure
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.optics.view_blocks import CENTRE, FOCAL
from calib.session import tolerances
from calib.session.parameter_names import CAMERA, COVER, number_of
from calib.session.shapes.layer import AIR, MEDIA, WATER
from calib.session.shapes.registry import find_dimension

WITH_TIME, FROM_VIEW = "with_time", "from_view"
ALTERNATING, WITH_NEARNESS, WITH_TILT = "alternating", "with_nearness", "with_tilt"
MANNERS: Mapping[str, str] = {
    EACH_VIEW: "differs in every view",
    WITH_TIME: "changes with time",
    FROM_VIEW: "changes at one view",
    ALTERNATING: "has two values",
    WITH_NEARNESS: "follows the distance of the board",
    WITH_TILT: "follows the tilt of the board",
}
"""The ways in which numbers differ from view to view, in plain words."""
VARYING_NUMBERS: Mapping[str, str] = {
    "focal": "the focal length",
    "principal_point": "the principal point",
    "lens": "the lens",
    "cover_offset": "the place of the cover",
    "cover_tilt": "the tilt of the cover",
    "cover_radius": "the radius of the cover",
    "thickness": "the thickness of the glass",
    "refractive_index": "the refractive index",
    "board_flex": "the bend of the board",
    "board_scale": "the print of the board",
    "rolling_shutter": "the motion of the board while a picture is read out",
}
"""Plain words for the numbers, by the name of the effect."""
SURROUNDINGS = "what is outside the cover"
"""Plain words for the index that differs if some views are in air and some in water."""
FOCAL_LENGTH = "focal"
"""The number that stands for fx and fy, by the same fraction."""
MIN_TURNED_PX = 2.0
"""px: the smallest change of a principal point that may be a half turn of the pictures."""
MIRRORED = 0.1
"""Two principal points mirror each other if their mean is this near the middle of the picture, in
halves of their distance.
"""
RADIAL_CHANGE = "lens.k1"
"""The number that stands for a change of the lens's distortion: it moves pixels in front of the
stated lens, as the effect `lens` does.
"""


def varying_number(name: str) -> EffectParameter:
    """Return the deviation of a number of the path from that of the other views: with the values
    that it shifts and, as its standard deviation, the tolerance of the number. Raise LookupError
    for another number.
    """
    if name == FOCAL_LENGTH:
        return EffectParameter.of(name, tolerances.FOCAL, CAMERA.focal, relative=True)
    if name in CAMERA.centre:
        return EffectParameter.of(name, tolerances.PRINCIPAL_POINT, (name,))
    if name == RADIAL_CHANGE:
        return EffectParameter.of(name, tolerances.RADIAL)
    if name == COVER.outside_index:
        return EffectParameter.of(name, tolerances.MEDIA, (name,))
    dimension = find_dimension(number_of(name))
    if not (dimension and dimension.tolerance):
        raise LookupError(name)
    return EffectParameter.of(name, dimension.tolerance, (name,))


@dataclass(frozen=True, slots=True)
class Varying(Effect):
    """Numbers of camera or cover that follow a pattern over the views.

    Where rays have no view, as in maps, the pattern is 0.
    """

    name: str  # type: ignore[misc]  # that of the numbers
    varies: str = field()  # type: ignore[misc]
    numbers: tuple[str, ...]
    """Each is one for which `varying_number` has an entry."""
    pattern: tuple[float, ...]
    """What the deviations follow, a number for each view."""
    description: ClassVar[str] = "Numbers differ from view to view."
    about: ClassVar[str] = "what differs from view to view"
    advice: ClassVar[str] = "record again, and keep everything as it is"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        del context
        return ()  # a pattern has to be found first

    @property
    def form(self) -> str:
        return self.varies

    @property
    def settled(self) -> bool:
        """True if the numbers are those after a change, False if they are those of the mean."""
        return max(self.pattern) <= 0 or min(self.pattern) >= 0

    @property
    def plain_numbers(self) -> str:
        """Plain words for its numbers."""
        return SURROUNDINGS if self.is_medium else VARYING_NUMBERS[self.name]

    @property
    def other_medium(self) -> str:
        """The medium of the views whose pattern is not 0."""
        return WATER if max(self.pattern) > 0 else AIR

    def is_half_turn(self, values: Values, width: int, height: int) -> bool:
        """Return True if a principal point changes to where a half turn of the pictures puts it.

        Args:
            width, height: px, of the pictures.
        """
        if self.numbers != CAMERA.centre or self.varies not in (FROM_VIEW, ALTERNATING):
            return False
        centre = torch.stack([values[name].reshape(()) for name in CAMERA.centre])
        change = torch.stack([values[param.name].reshape(()) for param in self.params])
        low, high = min(self.pattern), max(self.pattern)
        size = float(change.norm()) * (high - low)
        middle = torch.tensor([width - 1, height - 1], dtype=centre.dtype) / 2
        away = 2 * (centre - middle) + change * (low + high)
        return size > MIN_TURNED_PX and float(away.abs().max()) < MIRRORED * size

    @property
    def is_medium(self) -> bool:
        """True if some views were taken in air and some in water. The pattern is 0 in the stated
        medium; in the other one it is 1 in water or -1 in air.
        """
        return self.numbers == (COVER.outside_index,)

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        """The deviations for a pattern of 1."""
        parameters = tuple(
            replace(number, param=replace(number.param, name=self._name(number)), shifts=())
            for number in map(varying_number, self.numbers)
        )
        if self.is_medium:
            start, sigma = MEDIA[WATER] - MEDIA[AIR], tolerances.WATER_OVER_AIR.sigma
            return tuple(replace(number, start=start, sigma=sigma) for number in parameters)
        return parameters

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    def __call__(
        self, pixels: Tensor, values: Values, exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        if exposure is None or exposure.view is None:
            return pixels, values
        pattern = torch.tensor(self.pattern, dtype=pixels.dtype, device=pixels.device)
        followed = pattern[exposure.view]
        shifted = dict(values)
        for number in map(varying_number, self.numbers):
            change = values[self._name(number)] * followed
            for name in number.shifts:
                value = values[name]
                shifted[name] = value * (1 + change) if number.relative else value + change
        if RADIAL_CHANGE in self.numbers:
            change = values[self._name(varying_number(RADIAL_CHANGE))] * followed
            pixels = pixels + brown_shift(pixels, shifted, change)
        return pixels, shifted

    def _name(self, number: EffectParameter) -> str:
        return f"{self.name}.{self.varies}.{number.param.name}"


@dataclass(frozen=True, slots=True)
class CameraOfView(ViewEffect):
    """Every view has numbers of the camera of its own."""

    @property
    def plain_numbers(self) -> str:
        """Plain words for its numbers."""
        return VARYING_NUMBERS[self.name]

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if context.path.camera_block else (cls(),)

    @property
    def form(self) -> str:
        return self.varies

    def apply(self, path: Path) -> Path:
        return replace(self.with_prior(path), camera_block=self.per_view)


@dataclass(frozen=True, slots=True)
class FocalOfView(CameraOfView):
    """Every view has its own focal length, as with a lens that focuses by itself."""

    name: ClassVar[str] = "focal"
    description: ClassVar[str] = "The focal length differs in every view."
    advice: ClassVar[str] = "lock the focus"
    per_view: ClassVar[str] = FOCAL


@dataclass(frozen=True, slots=True)
class PrincipalPointOfView(CameraOfView):
    """Every view has its own principal point, as behind an image stabiliser."""

    name: ClassVar[str] = "principal_point"
    description: ClassVar[str] = "The principal point differs in every view."
    advice: ClassVar[str] = "switch the image stabiliser off"
    per_view: ClassVar[str] = CENTRE
