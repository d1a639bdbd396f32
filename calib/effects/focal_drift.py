"""The focal length changes over the session, as that of a lens does that warms up."""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from calib.effects.camera_effect import CameraEffect
from calib.effects.effect import EffectParameter
from calib.optics.exposure import Exposure
from calib.optics.params import Values
from calib.session.parameter_names import CAMERA
from calib.session.tolerances import FOCAL

DRIFT = EffectParameter.of("focal_drift.over_session", FOCAL)


@dataclass(frozen=True, slots=True)
class FocalDrift(CameraEffect):
    """A change by this fraction from the first picture to the last, linear in time; the stated
    value holds in the middle.
    """

    name: ClassVar[str] = "focal_drift"
    description: ClassVar[str] = "The focal length changes over the session."
    about: ClassVar[str] = "the lens"
    advice: ClassVar[str] = "take the same board pose at the beginning and at the end"
    camera_parameters: ClassVar[tuple[EffectParameter, ...]] = (DRIFT,)

    def __call__(
        self, pixels: Tensor, values: Values, exposure: Exposure | None, /
    ) -> tuple[Tensor, Values]:
        if exposure is None:
            return pixels, values
        factor = 1 + values[DRIFT.param.name] * exposure.time
        return pixels, {
            **values,
            **{name: values[name] * factor for name in CAMERA.focal},
        }
