"""What a calibration knows of its camera before pictures are checked: its parameters with their
covariance, and the corners' noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.apply.map_uncertainty import root_of
from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import Residuals, residuals
from calib.optics.board_target import with_blocks

Array = NDArray[np.float64]

LEAST_NOISE = 1e-3
"""px: corners that were computed are not trusted to be better."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A calibration as a prior."""

    model: CameraModel
    """Its means are the calibration's values."""
    parameters: Parameters
    """Those whose covariance is known, with the calibration's values as origin."""
    root: Array
    """(S, S) R with R R^T their covariance, over their scales."""
    sigma: float
    """px per axis: a corner's noise."""

    @staticmethod
    def of(calibration: Calibration) -> Known:
        """A number without a covariance is held: all of them, where the fit estimated none."""
        model = calibration.camera_model()
        parameters = model.parameters
        if calibration.covariance.size:
            root = root_of(calibration.covariance)
        elif parameters.relief:
            parameters, root = Parameters.none(model.means), np.zeros((0, 0))
        else:  # of a camera without a cover, whose covariance stands beside its intrinsics
            root = parameters.free_root()
        return Known(model, parameters, root, _sigma(calibration, model))

    def uncovered(self) -> Known:
        """The same camera without its cover."""
        path = replace(self.model.path, cover=())
        there = {param.name for param in path.params}
        free = tuple(param for param in self.parameters.free if param.name in there)
        kept = self.parameters.entries(param.name for param in free)
        covariance = self.root[kept] @ self.root[kept].T if len(kept) else np.zeros((0, 0))
        parameters = replace(self.parameters, relief=None, free=free)
        return replace(
            self,
            model=replace(self.model, path=path),
            parameters=parameters,
            root=root_of(covariance),
        )

    def posed(self, observations: Observations, poses: Tensor) -> tuple[Tensor, Residuals]:
        """The (V, B) poses of views through the calibration, from (V, 6) to start from, and what
        they leave.
        """
        path, values = self.model.path, self.model.means
        return refit_poses(
            path, values, observations, with_blocks(poses, path.view_blocks), sigma=self.sigma
        )


def _sigma(calibration: Calibration, model: CameraModel) -> float:
    sigma = float(calibration.settings.get("sigma_px", calibration.noise_px / 2**0.5))
    if not np.isfinite(sigma) and calibration.views:
        poses = torch.from_numpy(calibration.poses)
        sigma = residuals(model.path, model.means, calibration.observations, poses).rms_px / 2**0.5
    return max(sigma, LEAST_NOISE) if np.isfinite(sigma) else 1.0
