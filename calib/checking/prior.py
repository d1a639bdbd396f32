"""A calibration as the prior of a check: its parameters with their covariance, and the corners'
noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.apply.change_medium import replace_medium
from calib.calibration import Calibration
from calib.errors import InputError
from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import covariance_root
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import Residuals, residuals
from calib.estimation.surface_prior import relief_basis
from calib.optics.relief import AMPLITUDES
from calib.optics.view_blocks import with_blocks
from calib.session.schema import Number
from calib.session.shapes.layer import MEDIA, WATER, opposite_medium
from calib.session.tolerances import ANY_WATER

Array = NDArray[np.float64]

MIN_NOISE = 1e-3
"""The smallest noise in px; computed corners are not assumed to be better."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationPrior:
    """A calibration as the prior of a later fit."""

    model: CameraModel
    """The model; its means are the calibration's values."""
    parameters: Parameters
    """The parameters with a covariance; their origin is the calibration's values."""
    root: Array
    """(S, S) R, where R R^T is the covariance of the parameters over their scales."""
    sigma: float
    """The noise of a corner, px per axis."""
    in_other_medium: CalibrationPrior | None = None
    """The same camera and cover in water, if they were calibrated in air, or the other way round;
    None where the medium changes no ray, or was not asked for.
    """

    @staticmethod
    def with_media(calibration: Calibration) -> CalibrationPrior:
        """Make the prior, with that in the other medium."""
        prior = CalibrationPrior.of(calibration)
        medium = calibration.cover.medium
        if medium is None:
            return prior
        name = opposite_medium(medium.value)
        index = Number(MEDIA[name], ANY_WATER.sigma if name == WATER else 0.0)
        try:
            immersed = replace_medium(calibration, index)
        except InputError:  # a window that a diagnosis found has no known place in air
            return prior
        other = CalibrationPrior.of(immersed)
        return replace(prior, in_other_medium=replace(other, sigma=prior.sigma))

    @staticmethod
    def of(calibration: Calibration) -> CalibrationPrior:
        """Make the prior; numbers without a covariance are held."""
        model = calibration.camera_model()
        parameters = model.parameters
        if calibration.covariance.size:
            root = covariance_root(calibration.covariance)
        elif parameters.relief:
            parameters, root = Parameters.none(model.means), np.zeros((0, 0))
        else:  # without a cover, the intrinsics hold the covariance
            root = parameters.free_root()
        sigma = _sigma(calibration, model)
        model, parameters, to_fixed = fix_relief(model, parameters)
        return CalibrationPrior(model, parameters, to_fixed @ root, sigma)

    def uncovered(self) -> CalibrationPrior:
        """Return the prior of the same camera without its cover."""
        path = replace(self.model.path, cover=())
        names = {param.name for param in path.params}
        free = tuple(param for param in self.parameters.free if param.name in names)
        entries = self.parameters.entries(param.name for param in free)
        covariance = self.root[entries] @ self.root[entries].T if len(entries) else np.zeros((0, 0))
        parameters = replace(self.parameters, relief=None, free=free)
        return replace(
            self,
            model=replace(self.model, path=path),
            parameters=parameters,
            root=covariance_root(covariance),
        )

    def fit_poses(self, observations: Observations, poses: Tensor) -> tuple[Tensor, Residuals]:
        """Return the (V, B) poses of views through the calibration, fitted from the (V, 6) poses,
        and the residuals.
        """
        path, values = self.model.path, self.model.means
        return refit_poses(
            path, values, observations, with_blocks(poses, path.view_blocks), sigma=self.sigma
        )


def fix_relief(model: CameraModel, parameters: Parameters) -> tuple[CameraModel, Parameters, Array]:
    """Return the same model and parameters with a relief that stays on the glass as the cover
    moves, and the (S, S) matrix to these parameters, to first order.
    """
    if not parameters.relief or not parameters.relief.anchor:
        return model, parameters, np.eye(parameters.count)
    to_fixed = _to_fixed_relief(model, parameters)
    *inner, outer = model.path.cover
    assert outer.relief
    fixed = replace(outer, relief=replace(outer.relief, anchor=None, size=None))
    grown = model.path.relief_growth(model.means) * model.means[AMPLITUDES]
    path = replace(model.path, cover=(*inner, fixed))
    model = replace(model, path=path, means={**model.means, AMPLITUDES: grown})
    return model, replace(parameters, relief=path.relief, origin=model.means), to_fixed


def _to_fixed_relief(model: CameraModel, parameters: Parameters) -> Array:
    """Return the (S, S) matrix from the parameters of a relief that stays where the camera sees it
    to those of the same relief that stays on the glass, to first order.
    """
    relief, outer = parameters.relief, model.path.cover[-1]
    assert relief
    names = [param.name for param in parameters.free if not model.means[param.name].ndim]
    place = outer.relief_place(model.means)
    assert place
    low, high = relief.region
    rows = torch.linspace(low[0], high[0], relief.grid[0], dtype=torch.float64)
    columns = torch.linspace(low[1], high[1], relief.grid[1], dtype=torch.float64)
    first, second = torch.meshgrid(rows, columns, indexing="ij")
    chart = first.flatten(), second.flatten()
    expansion = place.to_chart(relief.expand(chart, model.means), chart)
    unit = torch.ones(1, len(chart[0]), dtype=torch.float64)
    zero = torch.zeros_like(unit)
    by_view = torch.cat(place.pull(expansion, chart, unit, (zero, zero)))  # (5, n) heights
    to_fixed = np.eye(parameters.count)
    to_fixed[: parameters.amplitudes] *= float(place.growth)
    scales = {param.name: param.scale for param in parameters.free}
    for name, rows in outer.view_derivatives(model.means, frozenset(names)).items():
        change = (by_view.T @ rows).numpy()[:, 0] * scales[name]
        entry = parameters.slices()[name].start
        to_fixed[: parameters.amplitudes, entry] = np.linalg.solve(relief_basis(relief), change)
    return to_fixed


def _sigma(calibration: Calibration, model: CameraModel) -> float:
    if joint := calibration.outcome.joint:
        return max(joint.sigma_px, MIN_NOISE)
    error = calibration.noise_px
    if error is None and calibration.views:
        poses = torch.from_numpy(calibration.poses)
        error = residuals(model.path, model.means, calibration.observations, poses).rms_px
    return max(error / 2**0.5, MIN_NOISE) if error is not None and np.isfinite(error) else 1.0
