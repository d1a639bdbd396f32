"""The model of a calibration, with the parameters that its fit estimated free again."""

from dataclasses import replace

import torch

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.estimation.prior_conflict import PRIOR_INFLATION
from calib.estimation.priors import Priors
from calib.estimation.stated_priors import priors_of, widen_prior
from calib.estimation.surface_prior import expected_amplitudes
from calib.optics.relief import AMPLITUDES
from calib.session.parameter_names import CAMERA
from calib.session.tolerances import OWN_CENTRE, OWN_COEFFICIENT, OWN_FOCAL


def base_model(calibration: Calibration) -> CameraModel:
    """Return the model at the declared values from which the calibration was fitted, without
    effects.
    """
    declared = calibration.declared
    as_declared = replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=declared.intrinsics),
        cover=declared.cover,
        effects=(),
    )
    path, values = as_declared.model()
    intrinsics, cover = declared.intrinsics, declared.cover
    for name in declared.doubted:
        intrinsics, cover = widen_prior(intrinsics, cover, name, PRIOR_INFLATION)
    priors = priors_of(intrinsics, cover, path)
    if calibration.outcome.intrinsics_from == "views":
        focal = OWN_FOCAL.sigma * float(values[CAMERA.fx])
        sigmas = {
            CAMERA.fx: focal,
            CAMERA.fy: focal,
            CAMERA.cx: OWN_CENTRE.sigma,
            CAMERA.cy: OWN_CENTRE.sigma,
        }
        sigmas = {
            param.name: sigmas.get(param.name, OWN_COEFFICIENT.sigma)
            for param in path.lens.params
            if not param.shape
        }
        priors = Priors({**priors.sigmas, **sigmas})
    if calibration.relief:
        values[AMPLITUDES] = torch.from_numpy(
            expected_amplitudes(calibration.relief, declared.cover.glass)
        )
    return CameraModel(path, values, priors)


def full_model(calibration: Calibration) -> CameraModel:
    """Return `base_model` with the calibration's effects."""
    return base_model(calibration).with_effects(added.effect for added in calibration.effects)
