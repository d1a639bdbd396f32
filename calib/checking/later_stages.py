"""The stages of a fit for views that the fit did not see, such as those of another medium."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.optics.build import covered_path, pinhole_path


def stages_of(calibration: Calibration) -> tuple[Stage, ...]:
    """Return the errors of the camera alone and of the smooth cover, both at their declared
    numbers, and of the calibration.
    """
    return tuple(_stages(calibration))


def _stages(calibration: Calibration) -> Iterator[Stage]:
    declared, observations = calibration.declared, calibration.observations
    path, values = pinhole_path(declared.intrinsics)
    poses = pinhole_poses(path, values, observations)
    bare = residuals(path, values, observations, poses)
    yield Stage("pinhole", bare.rms_px, bare.rmse_cm)
    path, values = covered_path(declared.intrinsics, declared.cover)
    smooth = residuals(
        path, values, observations, refine_poses(path, values, observations, poses).blocks
    )
    yield Stage("cover", smooth.rms_px, smooth.rmse_cm)
    path, values = calibration.model()
    final = residuals(path, values, observations, torch.from_numpy(calibration.poses))
    yield Stage(EFFECTS_STAGE if calibration.effects else "cover+rbf", final.rms_px, final.rmse_cm)
