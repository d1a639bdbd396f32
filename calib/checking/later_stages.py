"""What each stage of a fit would have left of a calibration's views, where it was made for another
medium and its own fit saw others.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch

from calib.calibration import Calibration, Stage
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.fitting.fit_result import STAGE
from calib.optics.build import covered_path, pinhole_path


def stages_of(calibration: Calibration) -> tuple[Stage, ...]:
    """The camera alone and the smooth cover by their declared numbers, and the calibration as it
    is.
    """
    return tuple(_stages(calibration))


def _stages(calibration: Calibration) -> Iterator[Stage]:
    declared, observations = calibration.declared, calibration.observations
    path, values = pinhole_path(declared.intrinsics)
    poses = pinhole_poses(observations, values)
    alone = residuals(path, values, observations, poses)
    yield Stage("pinhole", alone.rms_px, alone.rmse_cm)
    path, values = covered_path(declared.intrinsics, declared.cover)
    smooth = residuals(
        path, values, observations, refine_poses(path, values, observations, poses).blocks
    )
    yield Stage("cover", smooth.rms_px, smooth.rmse_cm)
    path, values = calibration.model()
    left = residuals(path, values, observations, torch.from_numpy(calibration.poses))
    yield Stage(STAGE if calibration.effects else "cover+rbf", left.rms_px, left.rmse_cm)
