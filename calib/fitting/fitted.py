"""The result of the stages of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from calib.calibration_content import Stage
from calib.corners.view import View
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.noise import corner_noise
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.board import Board

PINHOLE_STAGE = "pinhole"
SMOOTH_STAGE = "cover"
COVER_STAGE = "cover+rbf"
MAX_NOISE_RATIO = 1.3
"""A fit whose residual exceeds the corners' noise by this factor lacks something else, which may be
what pulls a number away from its declared value.
"""


def stage_of(name: str, residual: Residuals) -> Stage:
    """Return the record of a stage with these residuals."""
    return Stage(name, residual.rms_px, residual.rmse_cm)


@dataclass(frozen=True, slots=True)
class OnAverages:
    """Averages of the corners of a session with very many, and a fit to them: for questions."""

    observations: Observations
    joint: JointFit


@dataclass(frozen=True, slots=True)
class Fitted:
    """The model, poses and residuals after the last stage."""

    path: Path
    values: Values
    poses: Tensor
    stages: tuple[Stage, ...]
    residuals: Residuals
    relief: Relief | None = None
    joint: JointFit | None = None
    model: CameraModel | None = None
    """The model of the joint fit; None without one."""
    turned: tuple[str, ...] = ()
    """The views that show the board turned by a quarter turn. This fit has them as they are."""
    on_averages: OnAverages | None = None
    """The fit of the same model to averages of the corners; None if they are not very many."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the path: the board's bend, or none."""
        return self.model.effects if self.model else ()

    def leaves_noise(
        self, views: Sequence[View], board: Board, ratio: float = MAX_NOISE_RATIO
    ) -> bool:
        """Return True if the error is at most so many times the corners' noise, and this is
        known.
        """
        noise = corner_noise(self.residuals.image, views, board)
        return noise is not None and self.residuals.rms_px <= ratio * noise
