"""The model that a diagnosis starts from: a calibration's, with what its fit estimated free again."""

from dataclasses import replace

import torch
from torch import Tensor

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.estimation.doubt import DOUBT
from calib.estimation.stated_priors import freed
from calib.session.tolerances import OWN_CENTRE, OWN_COEFFICIENT, OWN_FOCAL


def base_model(calibration: Calibration) -> CameraModel:
    """What the calibration's fit started from, as far as it says, without any effect."""
    declared = calibration.declared
    as_declared = replace(calibration, camera=replace(calibration.camera, intrinsics=declared.intrinsics), cover=declared.cover, effects=())
    path, values = as_declared.model()
    free: dict[str, float | Tensor] = dict(freed(declared.intrinsics, declared.cover, path))
    free |= {name: DOUBT * free[name] for name in declared.doubted}
    if calibration.settings.get("intrinsics_from") == "views":
        focal = OWN_FOCAL.sigma * float(values["camera.fx"])
        own = {"camera.fx": focal, "camera.fy": focal, "camera.cx": OWN_CENTRE.sigma, "camera.cy": OWN_CENTRE.sigma}
        free |= {param.name: own.get(param.name, OWN_COEFFICIENT.sigma) for param in path.lens.params}
    if calibration.relief:
        values["relief.amplitudes"] = torch.zeros_like(values["relief.amplitudes"])
    return CameraModel(path, values, free)


def model_of(calibration: Calibration) -> CameraModel:
    """The same, with the calibration's effects."""
    return base_model(calibration).with_effects(found.effect for found in calibration.effects)
