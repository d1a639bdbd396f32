"""Everything that the figures of a report are drawn from, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from calib.apply.map_uncertainty import NO_CORNERS, SigmaField, predicted_sigma
from calib.calibration import Calibration
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.poses import pinhole_poses
from calib.estimation.residuals import Residuals, residuals
from calib.optics.build import pinhole_path
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.camera import Intrinsics
from calib.session.lens import OPENCV
from calib.undistortion.ray_field import RayField

Array = NDArray[np.float64]

CELLS = (16, 12)
"""Across and down the image, for what is counted or averaged by place."""

FEWEST_SEEN = 0.5
"""Of a calibration's corners, that its own model sees: a fit drops a session in which a fifth
cannot be.
"""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A calibration with its model asked at the training corners (M of them) and over the image."""

    calibration: Calibration
    path: Path
    values: Values
    missed: Residuals
    """By the model."""
    bare_missed: Residuals | None
    """Without what was modelled: by the camera without its cover, or, if it has none, without its
    lens distortion. None: the model is a pinhole already.
    """
    pixels: Array
    """(M, 2) px"""
    view: NDArray[np.int64]
    """(M,) each corner's view."""
    depth: Array
    """(M,) m, z of each corner in the camera frame."""
    distance: Array
    """(M,) m, how far away each corner is (`Path.distance`): its depth, but of a wide lens."""
    field: RayField
    sigma: SigmaField | None
    """None where the fit estimated no covariance."""
    depths: tuple[float, ...]
    """m, near to far: where fields are shown."""

    @property
    def reach(self) -> tuple[float, float]:
        """m: how far away the nearest and the farthest corner are. A corner behind a lens that is
        not wide does not count: the model does not see it.
        """
        ahead = self.distance[self.distance > 0]
        return float(ahead.min()), float(ahead.max())

    @property
    def distance_name(self) -> str:
        """The distances' name for axes and titles."""
        return "distance" if self.path.lens.wide else "depth"

    @property
    def errors(self) -> Array:
        """(M, 2) px: the reprojection error; NaN where the model does not see the corner."""
        return self.missed.image.numpy()

    @cached_property
    def cell(self) -> NDArray[np.int64]:
        """(M,) the cell of the image that each corner lies in, row by row."""
        camera = self.calibration.camera
        at = (self.pixels + 0.5) / [camera.width, camera.height] * CELLS
        column, row = np.clip(at.astype(np.int64), 0, np.array(CELLS) - 1).T
        return np.asarray(row * CELLS[0] + column)

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(rows, columns) corners in each cell of the image."""
        return np.bincount(self.cell, minlength=CELLS[0] * CELLS[1]).reshape(CELLS[1], CELLS[0])

    @cached_property
    def covered(self) -> float:
        """Of the image, which part has corners."""
        return float((self.counts > 0).mean())

    @cached_property
    def rms_by_view(self) -> Array:
        """(V,) px"""
        squared = np.nan_to_num((self.errors**2).sum(-1))
        seen = np.isfinite(self.errors).all(-1)
        views = len(self.calibration.views)
        return np.asarray(
            np.sqrt(
                np.bincount(self.view, squared, views)
                / np.maximum(np.bincount(self.view, seen, views), 1)
            )
        )

    def shows(self, pixels: Array) -> NDArray[np.bool_]:
        """(...) whether figures show the undistortion of (..., 2) px. That of a wide lens grows
        without bounds towards 90 degrees from the axis, so they show what its undistorted picture
        holds.
        """
        if not self.path.lens.wide:
            return np.ones(pixels.shape[:-1], dtype=np.bool_)
        return self.field.holds(pixels.reshape(-1, 2)).reshape(pixels.shape[:-1])

    def sigma_at_nodes(self, depth: float) -> Array:
        """(h, w) px, as `SigmaField.at_nodes`; NaN where that is not shown."""
        assert self.sigma
        nodes = np.stack(np.meshgrid(self.sigma.nodes_x, self.sigma.nodes_y), -1)
        return np.where(self.shows(nodes), self.sigma.at_nodes(depth), np.nan)

    def sigma_at_corners(self, depth: float) -> Array:
        """(n,) px: how sure the map of a depth (m) is where it was trained; empty without a
        covariance.
        """
        if not self.sigma:
            return np.zeros(0)
        found = self.sigma.at(self.pixels[:, :1], self.pixels[:, 1:], depth)[:, 0]
        return found[np.isfinite(found) & self.shows(self.pixels)].astype(np.float64)


def gather_evidence(calibration: Calibration, depths: tuple[float, ...] = ()) -> Evidence:
    """Ask a calibration; without depths, its fields are shown at the nearest, the median and the
    farthest corner's.
    """
    if not (calibration.views and calibration.stages):
        advice = (
            "bring it up to date by pictures taken there (calib check --update)"
            if "immersed" in calibration.settings
            else "fit the session again"
        )
        raise NotEnoughDataError(
            f"the calibration keeps no views, of which a report would tell: {advice}."
        )
    path, values = calibration.model()
    observations = calibration.observations
    own = torch.from_numpy(calibration.poses)[observations.view]
    places = path.place(observations.corners, values, own)
    depth, distance = places[:, 2].numpy(), path.distance(places).numpy()
    missed, sigma = (
        residuals(path, values, observations, torch.from_numpy(calibration.poses)),
        predicted_sigma(calibration),
    )
    seen = torch.isfinite(missed.image).all(-1).double().mean()
    if (
        not (distance > 0).any()
        or seen < FEWEST_SEEN
        or (sigma and not np.isfinite(sigma.variance).any())
    ):
        raise InputError(NO_CORNERS)
    return Evidence(
        calibration=calibration,
        path=path,
        values=values,
        missed=missed,
        bare_missed=_without_model(calibration),
        pixels=observations.pixels.numpy(),
        view=observations.view.numpy(),
        depth=depth,
        distance=distance,
        field=calibration.ray_field(),
        sigma=sigma,
        depths=tuple(sorted(set(depths)))
        or tuple(
            dict.fromkeys(
                float(f"{d:.2g}") for d in np.quantile(distance[distance > 0], (0, 0.5, 1))
            )
        ),
    )


def _without_model(calibration: Calibration) -> Residuals | None:
    k = calibration.camera.intrinsics
    assert k
    if calibration.cover.shape == "none":
        if k.model == OPENCV and not any(number.value for number in k.distortion):
            return None
        k = Intrinsics(k.fx, k.fy, k.cx, k.cy)
    path, values = pinhole_path(k)
    observations = calibration.observations
    return residuals(path, values, observations, pinhole_poses(observations, values))
