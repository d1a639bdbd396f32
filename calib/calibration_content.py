"""The content of a result: the numbers of a camera behind a cover, and all inputs of their fit."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import RejectedPicture, View, capture_times
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.fit_record.history import History
from calib.fit_record.outcome import FitOutcome
from calib.fit_record.record_file import record_to_yaml
from calib.fit_record.request import FitRequest
from calib.optics.build import covered_path, with_relief
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.version import VERSION

TITLES = {
    "pinhole": "camera alone",
    "cover": "smooth cover",
    "cover+rbf": "fitted cover",
    "cover+rbf+effects": "effects found",
}
"""The titles of a fit's stages in reports."""
MEANINGS = {
    "pinhole": "the lens as given or as first estimated, with no cover in the model",
    "cover": "with a smooth cover, as declared or as first estimated",
    "cover+rbf": "lens and cover as fitted, with uneven glass if the pictures show it",
    "cover+rbf+effects": "as fitted, with the board as the pictures show it and all effects found",
}
"""The models of a fit's stages in words."""


@dataclass(frozen=True, slots=True)
class Stage:
    """The error of the model after one stage of the fit."""

    name: str
    """pinhole, cover, cover+rbf"""
    rms_px: float
    """Root mean square two-dimensional reprojection error."""
    rmse_cm: float
    """Root mean square distance on the board."""

    @property
    def title(self) -> str:
        return TITLES.get(self.name, self.name)

    @property
    def meaning(self) -> str:
        """The model of the stage, in words; empty for a stage of an unknown name."""
        return MEANINGS.get(self.name, "")


@dataclass(frozen=True, slots=True)
class Declared:
    """The camera and cover as the session declares them. Each number has its tolerance, the
    standard deviation of its prior; 0 if the fit held it.
    """

    intrinsics: Intrinsics
    cover: Cover
    doubted: tuple[str, ...] = ()
    """Numbers that the views contradict, by their names in the ray path. The fit widened their
    priors by calib.estimation.prior_conflict.PRIOR_INFLATION.
    """


@dataclass(frozen=True, slots=True, eq=False)
class AddedEffect:
    """An effect that the diagnosis or the user added, with its estimated parameters."""

    effect: Effect
    parameters: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    """Value and standard deviation by parameter name: arrays of the same shape, in the parameter's
    unit.
    """


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CalibrationContent:
    """A camera, its cover, and the evidence for both."""

    board: Board
    camera: Camera
    """The camera; its intrinsics are never None."""
    cover: Cover
    relief: Relief | None
    amplitudes: NDArray[np.float64]
    """(rows, columns) m, of the relief; (0, 0) without one."""
    exact_hit: bool
    """True if the relief moves the hit point; false if it only bends the normal (the paper)."""
    views: tuple[View, ...]
    """The fitted views."""
    poses: NDArray[np.float64]
    """(V, 6) T_camera_board of each view: rotation vector (rad) and translation (m); (V, 12) if
    boards move during the readout.
    """
    covariance: NDArray[np.float64]
    """(S, S) covariance of `camera_model().parameters`, poses marginalised; (0, 0) if it was not
    estimated.
    """
    rejected: tuple[RejectedPicture, ...]
    stages: tuple[Stage, ...]
    noise_px: float | None
    """Noise of the corners: root mean square of the two-dimensional error, from the short-scale
    residual; None if too few corners tell it.
    """
    gauge: str
    """The convention that fixes the rigid motion which board views do not determine."""
    request: FitRequest = field(default_factory=FitRequest)
    """The request of the fit."""
    outcome: FitOutcome = field(default_factory=FitOutcome)
    """The record of its outcome."""
    history: History = field(default_factory=History)
    """The changes since the fit."""
    effects: tuple[AddedEffect, ...] = ()
    """The effects of the model."""
    stated: Declared | None = None
    """The declared numbers; None if they are those of `camera` and `cover`, all held."""
    refracal: str = VERSION
    """The version of Refracal that made the calibration."""
    corners_at: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) pixel (px) and depth (m) of the training corners, for a calibration that was converted
    to another medium and has no views.
    """

    @property
    def observations(self) -> Observations:
        """Return the detected corners of the views, with their capture times."""
        return _observations_of(self)

    @property
    def declared(self) -> Declared:
        """Return the means and standard deviations of the priors with which camera and cover were
        fitted.
        """
        assert self.camera.intrinsics
        return self.stated or Declared(self.camera.intrinsics, self.cover)

    def model(self) -> tuple[Path, dict[str, Tensor]]:
        """Return the ray path and its parameter values, in torch."""
        assert self.camera.intrinsics
        path, values = covered_path(self.camera.intrinsics, self.cover)
        if self.relief:
            path = with_relief(path, self.relief, exact_hit=self.exact_hit)
            values["relief.amplitudes"] = torch.from_numpy(self.amplitudes)
        for added in self.effects:
            path = added.effect.apply(path)
            values |= {
                name: torch.from_numpy(value) for name, (value, _) in added.parameters.items()
            }
        return path, values

    def camera_model(self) -> CameraModel:
        """Return the ray path at the calibration's values, with the priors of all parameters that
        its fit estimated, including those of effects.
        """
        assert self.camera.intrinsics
        path, values = self.model()
        priors = priors_of(self.camera.intrinsics, self.cover, path)
        priors = priors.with_sigmas(
            {
                parameter.param.name: parameter.sigma
                for added in self.effects
                for parameter in added.effect.effect_parameters
            }
        )
        return CameraModel(path, values, priors, tuple(added.effect for added in self.effects))

    def record(self) -> dict[str, Any]:
        """Return the entries of the key `settings` in calibration.yaml."""
        return record_to_yaml(self.request, self.outcome, self.history)


@lru_cache(maxsize=1)  # a report and its verdict ask some thirty times
def _observations_of(content: CalibrationContent) -> Observations:
    """Return the detected corners of a calibration's views, with their capture times."""
    return Observations.of(content.views, content.board).add_times(
        capture_times(content.views), content.camera.height
    )
