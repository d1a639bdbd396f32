"""The lens's distortion differs from any polynomial: a smooth free-form displacement over the
image. The camera stays central.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from calib.effects.cosine_field import FIRST_KNEE, CosineField
from calib.effects.effect import EffectContext
from calib.optics.exposure import Exposure
from calib.optics.linear_term import with_slopes
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.parameter_names import CAMERA


@dataclass(frozen=True, slots=True)
class LensField(CosineField):
    """A displacement of the pixels in front of the stated lens.

    At `centre`, the principal point, the shift and its slope along its own direction are zero. So
    the focal lengths and the principal point mean what they mean without the field.
    """

    centre: tuple[float, ...] = ()
    """px: x and y. Empty in older files, where the shift there is free."""

    name: ClassVar[str] = "lens_field"
    description: ClassVar[str] = "The lens's distortion differs from any polynomial."
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = (
        "move the board over the whole picture, near and far, and turn it by 90 degrees in some"
        " views"
    )
    area: ClassVar[str] = "lens_field"
    unit: ClassVar[str] = "px"
    scale: ClassVar[float] = 0.1
    first_size: ClassVar[float] = 0.5

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return (
            cls(
                (-0.5, -0.5),
                (context.width - 0.5, context.height - 0.5),
                cls.first_size,
                FIRST_KNEE,
                tuple(float(context.values[name]) for name in CAMERA.centre),
            ),
        )

    def shift(self, x: Tensor, y: Tensor, values: Values) -> list[tuple[Tensor, Tensor, Tensor]]:
        shifts = super(LensField, self).shift(x, y, values)
        if not self.centre:
            return shifts
        (shift_x, x_by_x, x_by_y), (shift_y, y_by_x, y_by_y) = shifts
        lines = [
            (values[name] @ waves, values[name] @ slopes)
            for name, (waves, slopes) in zip(self.probes, self._waves_at_centre(x), strict=True)
        ]
        shift_x = shift_x - lines[0][0] - lines[0][1] * (x.detach() - self.centre[0])
        shift_y = shift_y - lines[1][0] - lines[1][1] * (y.detach() - self.centre[1])
        return [(shift_x, x_by_x - lines[0][1], x_by_y), (shift_y, y_by_x, y_by_y - lines[1][1])]

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        weights = super(LensField, self).weights(x, y)
        if not self.centre:
            return weights
        for coordinate, middle, name, (waves, slopes) in zip(
            (x, y), self.centre, self.probes, self._waves_at_centre(x), strict=True
        ):
            weights[name] = weights[name] - waves - slopes * (coordinate - middle)[..., None]
        return weights

    def _waves_at_centre(self, like: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return for each direction the (81,) waves at the centre and their slopes along it."""
        centre = torch.tensor(self.centre, dtype=like.dtype, device=like.device)
        (cosines_x, rise_x), (cosines_y, rise_y) = self._cosines(*centre)
        falls = self._falls(like.dtype).to(like.device).flatten()
        waves = torch.outer(cosines_x, cosines_y).flatten() * falls
        return [
            (waves, torch.outer(rise_x, cosines_y).flatten() * falls),
            (waves, torch.outer(cosines_x, rise_y).flatten() * falls),
        ]

    def apply(self, path: Path) -> Path:
        return replace(path, adjustments=(*path.adjustments, self))

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        x, y = pixels.unbind(-1)
        shifts = [
            with_slopes(shift, x, y, by_x, by_y) for shift, by_x, by_y in self.shift(x, y, values)
        ]
        return pixels + torch.stack(shifts, -1), values
