"""A calibration with the result of another fit."""

from __future__ import annotations

from dataclasses import replace

from calib.calibration import AddedEffect, Calibration, Stage
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import with_estimates

EFFECTS_STAGE = "cover+rbf+effects"


def with_fit(
    calibration: Calibration, model: CameraModel, joint: JointFit, observations: Observations
) -> Calibration:
    """Return the calibration with the parameters and effects of another fit."""
    assert calibration.camera.intrinsics
    intrinsics, cover = with_estimates(calibration.camera.intrinsics, calibration.cover, joint)
    effects = tuple(
        AddedEffect(
            effect,
            {
                parameter.param.name: (
                    joint.values[parameter.param.name].numpy(),
                    joint.sigma_of(parameter.param.name).numpy(),
                )
                for parameter in effect.effect_parameters
            },
        )
        for effect in model.effects
    )
    residual = residuals(model.path, joint.values, observations, joint.poses)
    stages = tuple(stage for stage in calibration.stages if stage.name != EFFECTS_STAGE)
    return replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=intrinsics),
        cover=cover,
        amplitudes=(
            joint.values["relief.amplitudes"].numpy()
            if calibration.relief
            else calibration.amplitudes
        ),
        poses=joint.poses.numpy(),
        covariance=joint.saved_covariance,
        effects=effects,
        stages=(*stages, Stage(EFFECTS_STAGE, residual.rms_px, residual.rmse_cm))
        if effects
        else stages,
        settings=calibration.settings | joint.record(),
    )
