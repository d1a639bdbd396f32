"""The principal point is not as stated."""

from dataclasses import dataclass
from typing import ClassVar, Self

from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import EffectContext, EffectParameter
from calib.effects.offset import add_increments
from calib.optics.exposure import Exposure
from calib.optics.params import Values
from calib.session.parameter_names import CAMERA
from calib.session.tolerances import PRINCIPAL_POINT

UNKNOWNS = tuple(
    EffectParameter.of(f"principal_point.{axis}", PRINCIPAL_POINT, (CAMERA.of(f"c{axis}"),))
    for axis in "xy"
)


@dataclass(frozen=True, slots=True)
class PrincipalPoint(CameraEffect):
    """A shift of the principal point to the right and down, px."""

    name: ClassVar[str] = "principal_point"
    description: ClassVar[str] = "The principal point is not as stated."
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "turn the camera, or the board, by 90 degrees in some views"
    camera_parameters: ClassVar[tuple[EffectParameter, ...]] = UNKNOWNS

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return () if {*CAMERA.centre} & context.estimated else (cls(),)

    def __call__(
        self, pixels: Tensor, values: Values, _exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        return pixels, add_increments(values, UNKNOWNS)
