"""The data that the figures of a report share, computed once."""

from __future__ import annotations

from collections.abc import Sequence
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
from calib.fitting.corner_range import (
    CELLS,
    corner_residuals,
    covered_fraction,
    distance_range,
    picture_region,
)
from calib.fitting.supported_depths import FAR
from calib.optics.build import pinhole_path
from calib.optics.params import Values
from calib.optics.path import Path
from calib.rounding import two_digits
from calib.session.camera import Intrinsics
from calib.session.lens import OPENCV
from calib.undistortion.ray_field import RayField

Array = NDArray[np.float64]

MIN_VISIBLE_FRACTION = 0.5
"""The smallest fraction of a calibration's corners that its own model must see. A fit refuses a
session in which it cannot see a fifth.
"""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A calibration, and its model evaluated at the M training corners and over the image."""

    calibration: Calibration
    path: Path
    values: Values
    residuals: Residuals
    """Residuals of the model."""
    bare_residuals: Residuals | None
    """Residuals of the camera without its cover or, if it has none, without its lens distortion.
    None if the model is a pinhole already.
    """
    pixels: Array
    """(M, 2) px"""
    view: NDArray[np.int64]
    """(M,) the view of each corner."""
    points: Array
    """(M, 3) m, each corner in the camera frame."""
    distance: Array
    """(M,) m, the distance of each corner (`Path.distance`): its depth, except for a wide lens."""
    field: RayField
    sigma: SigmaField | None
    """None where the fit estimated no covariance."""
    depths: tuple[float, ...]
    """The depths in m, near to far, at which fields are drawn."""

    @property
    def depth(self) -> Array:
        """(M,) m, z of each corner in the camera frame."""
        return self.points[:, 2]

    @property
    def reach(self) -> tuple[float, float]:
        """m: how far away the nearest and the farthest corner are (`distance_range`)."""
        return distance_range(self.distance)

    @property
    def distance_name(self) -> str:
        """The name of `distance` on axes and in titles."""
        return "distance" if self.path.lens.wide else "depth"

    @property
    def limit_caption(self) -> str:
        """A sentence on the empty parts of a figure over the image; empty unless the lens is
        wide.
        """
        if not self.path.lens.wide:
            return ""
        return " Empty: what the undistorted picture of this camera does not show."

    @property
    def errors(self) -> Array:
        """(M, 2) px: the reprojection error; NaN where the model does not see the corner."""
        return self.residuals.image.numpy()

    @cached_property
    def corner(self) -> NDArray[np.int64]:
        """(M,) the number of each corner on its board, row by row."""
        return np.concatenate([np.flatnonzero(view.seen) for view in self.calibration.views])

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
        """The fraction of the image's cells with corners, 0 to 1 (`covered_fraction`)."""
        return covered_fraction(self.calibration, self.pixels)

    @cached_property
    def rms_by_view(self) -> Array:
        """(V,) px"""
        squared = np.nan_to_num((self.errors**2).sum(-1))
        visible = np.isfinite(self.errors).all(-1)
        views = len(self.calibration.views)
        return np.asarray(
            np.sqrt(
                np.bincount(self.view, squared, views)
                / np.maximum(np.bincount(self.view, visible, views), 1)
            )
        )

    def shows(self, pixels: Array) -> NDArray[np.bool_]:
        """Return (...), true where figures show the undistortion of (..., 2) px.

        The undistortion of a wide lens grows without bounds towards 90 degrees from the axis, so
        figures show only the pixels that its undistorted picture holds.
        """
        if not self.path.lens.wide:
            return np.ones(pixels.shape[:-1], dtype=np.bool_)
        return self.field.holds(pixels.reshape(-1, 2)).reshape(pixels.shape[:-1])

    def sigma_at_nodes(self, depth: float) -> Array:
        """Return (h, w) px, as `SigmaField.at_nodes`; NaN where figures do not show it."""
        assert self.sigma
        nodes = np.stack(np.meshgrid(self.sigma.nodes_x, self.sigma.nodes_y), -1)
        return np.where(self.shows(nodes), self.sigma.at_nodes(depth), np.nan)

    def worst_sigma(self, depths: Sequence[float]) -> str:
        """Return the largest standard deviation of the maps of these depths (m), and the part of
        the picture that has it, as text.
        """
        assert self.sigma
        fields = np.stack([self.sigma_at_nodes(depth) for depth in depths])  # (D, h, w) px
        layer, row, column = np.unravel_index(np.nanargmax(fields), fields.shape)
        camera = self.calibration.camera
        x, y = self.sigma.nodes_x[column], self.sigma.nodes_y[row]
        region = picture_region(float(x) / camera.width, float(y) / camera.height)
        depth = f" at {depths[int(layer)]:g} m" if len(depths) > 1 else ""
        return f"{two_digits(np.nanmax(fields))} px {region}{depth}"


def gather_evidence(calibration: Calibration, depths: tuple[float, ...] = ()) -> Evidence:
    """Evaluate a calibration; without depths, fields are drawn at the depths of the nearest, the
    median and the farthest corner.
    """
    if not (calibration.views and calibration.stages):
        advice = (
            "update it with pictures taken there (calib check --update)"
            if calibration.history.medium_change
            else "fit the session again"
        )
        raise NotEnoughDataError(f"the calibration has no views to report on: {advice}.")
    path, values = calibration.model()
    observations = calibration.observations
    pose = torch.from_numpy(calibration.poses)[observations.view]
    points = path.place(observations.corners, values, pose, observations.exposure)
    distance = path.distance(points).numpy()
    residual, sigma = corner_residuals(calibration), predicted_sigma(calibration)
    visible_fraction = torch.isfinite(residual.image).all(-1).double().mean()
    if (
        not (distance > 0).any()
        or visible_fraction < MIN_VISIBLE_FRACTION
        or (sigma and not np.isfinite(sigma.variance).any())
    ):
        raise InputError(NO_CORNERS)
    return Evidence(
        calibration=calibration,
        path=path,
        values=values,
        residuals=residual,
        bare_residuals=_without_model(calibration),
        pixels=observations.pixels.numpy(),
        view=observations.view.numpy(),
        points=points.numpy(),
        distance=distance,
        field=calibration.ray_field(),
        sigma=sigma,
        depths=tuple(sorted({min(depth, FAR) for depth in depths}))
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
    return residuals(path, values, observations, pinhole_poses(path, values, observations))
