"""The focal length is not as stated."""

from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import EffectContext, EffectParameter
from calib.effects.offset import add_increments
from calib.optics.exposure import Exposure
from calib.optics.params import Values
from calib.session.parameter_names import CAMERA
from calib.session.tolerances import FOCAL

CHANGE = EffectParameter.of("focal.change", FOCAL, CAMERA.focal, relative=True)


@dataclass(frozen=True, slots=True)
class Focal(CameraEffect):
    """An increase of fx and fy by the same fraction."""

    name: ClassVar[str] = "focal"
    description: ClassVar[str] = "The focal length is not as stated."
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "tilt the board, and hold it near and far"
    camera_parameters: ClassVar[tuple[EffectParameter, ...]] = (CHANGE,)

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if {*CAMERA.focal} & context.estimated else (cls(),)

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        return pixels, add_increments(values, (CHANGE,))
