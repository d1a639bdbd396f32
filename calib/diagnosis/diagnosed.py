"""A calibration as a fit with effects leaves it."""

from __future__ import annotations

from dataclasses import replace

from calib.calibration import AddedEffect, Calibration, Stage
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import with_estimates

STAGE = "cover+rbf+effects"


def with_fit(
    calibration: Calibration, model: CameraModel, joint: JointFit, observations: Observations
) -> Calibration:
    """The calibration with another fit's parameters and effects."""
    assert calibration.camera.intrinsics
    intrinsics, cover = with_estimates(calibration.camera.intrinsics, calibration.cover, joint)
    effects = tuple(
        AddedEffect(
            e,
            {
                u.param.name: (
                    joint.values[u.param.name].numpy(),
                    joint.sigma_of(u.param.name).numpy(),
                )
                for u in e.effect_parameters
            },
        )
        for e in model.effects
    )
    missed = residuals(model.path, joint.values, observations, joint.poses)
    stages = tuple(stage for stage in calibration.stages if stage.name != STAGE)
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
        stages=(*stages, Stage(STAGE, missed.rms_px, missed.rmse_cm)) if effects else stages,
        settings=calibration.settings | joint.record(),
    )
