"""A calibration with the result of another fit."""

from __future__ import annotations

from dataclasses import replace

from calib.calibration import AddedEffect, Calibration, Stage
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import Estimate, JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import with_estimates
from calib.fit_record.outcome import JointOutcome

EFFECTS_STAGE = "cover+rbf+effects"


def with_fit(
    calibration: Calibration, model: CameraModel, joint: JointFit, observations: Observations
) -> Calibration:
    """Return the calibration with the parameters and effects of another joint fit, and the
    record of that fit.
    """
    estimated = with_estimate(calibration, model, joint, observations)
    outcome = replace(calibration.outcome, joint=JointOutcome.of(joint))
    return replace(estimated, outcome=outcome)


def with_estimate(
    calibration: Calibration, model: CameraModel, estimate: Estimate, observations: Observations
) -> Calibration:
    """Return the calibration with the parameters and effects of another estimate."""
    assert calibration.camera.intrinsics
    intrinsics, cover = with_estimates(calibration.camera.intrinsics, calibration.cover, estimate)
    effects = tuple(
        AddedEffect(
            effect,
            {
                parameter.param.name: (
                    estimate.values[parameter.param.name].numpy(),
                    estimate.sigma_of(parameter.param.name).numpy(),
                )
                for parameter in effect.effect_parameters
            },
        )
        for effect in model.effects
    )
    residual = residuals(model.path, estimate.values, observations, estimate.poses)
    stages = tuple(stage for stage in calibration.stages if stage.name != EFFECTS_STAGE)
    return replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=intrinsics),
        cover=cover,
        amplitudes=(
            estimate.values["relief.amplitudes"].numpy()
            if calibration.relief
            else calibration.amplitudes
        ),
        poses=estimate.poses.numpy(),
        covariance=estimate.saved_covariance,
        effects=effects,
        stages=(*stages, Stage(EFFECTS_STAGE, residual.rms_px, residual.rmse_cm))
        if effects
        else stages,
    )
