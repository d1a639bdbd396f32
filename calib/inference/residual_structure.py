"""The structure of a residual: the parts of its variance that image position, board position,
motion, time, refraction and sub-pixel phase explain.

This also works for effects without a name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import fdtrc

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import Estimate
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals

Array = NDArray[np.float64]
Basis = tuple[NDArray[np.int64], Array]
"""(M,) the group of each corner, and (M, k) columns with separate coefficients in each group."""

CELLS = (8, 6)
"""Columns and rows of the cells of the image."""
MAX_P_VALUE = 1e-3
"""The largest p-value of a significant share, to be divided by the number of shares."""
MIN_FRACTION = 0.03
"""The smallest fraction of the variance, above chance, that is reported."""


@dataclass(frozen=True, slots=True)
class VarianceShare:
    """The part of the variance that one coordinate explains."""

    organised_by: str
    fraction: float
    """The fraction of the residual's variance."""
    chance: float
    """The fraction that it would explain of pure noise."""
    p_value: float


@dataclass(frozen=True, slots=True)
class ResidualScene:
    """A residual with the coordinates that may explain it. Views have equal weights, whatever their
    scatter.
    """

    observations: Observations
    residual: Array
    """(M, 2) px"""
    distance: Array
    """(M,) m, the distance of each corner (`Path.distance`)."""
    incidence: Array
    """(M,) the cosine between the ray and the normal of the cover, or the optical axis without a
    cover.
    """
    width: int
    height: int

    def split(self) -> list[VarianceShare]:
        """Return the shares of all coordinates, the largest excess over chance first."""
        normalised = self.residual / self._typical()[:, None]
        shares = [self._share(name, basis(self), normalised) for name, basis in ORGANISERS.items()]
        return sorted(shares, key=lambda share: share.chance - share.fraction)

    def _typical(self) -> Array:
        """Return (M,) px, the median length of the residuals of each corner's view."""
        view = self.observations.view.numpy()
        length = np.hypot(*self.residual.T)
        sizes = np.array(
            [np.median(length[view == v]) for v in range(len(self.observations.names))]
        )
        return np.asarray(np.maximum(sizes, 1e-9)[view])

    def _share(self, name: str, basis: Basis, normalised: Array) -> VarianceShare:
        """Project both components of the residual on a basis."""
        group, columns = basis
        order = np.argsort(group, kind="stable")
        explained, dimensions = 0.0, 0
        for rows_of_group in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
            u, s, _ = np.linalg.svd(columns[rows_of_group], full_matrices=False)
            u = u[:, s > 1e-9 * s.max()]
            explained += float(((u.T @ normalised[rows_of_group]) ** 2).sum())
            dimensions += u.shape[1]
        rows = normalised.size
        columns_used = 2 * dimensions
        chance = columns_used / rows
        total = float((normalised**2).sum())
        if not total:  # exact data have no variance to explain
            return VarianceShare(name, 0.0, chance, 1.0)
        fraction = min(1.0, explained / total)
        p_value = _f_test(fraction, columns_used, rows - columns_used)
        return VarianceShare(name, fraction, chance, p_value)


def _f_test(fraction: float, dimensions: int, freedom: int) -> float:
    """Return the p-value of a fraction of the variance that columns of noise would explain (F
    test): 0 if they explain all of it, 1 if they leave no degrees of freedom.
    """
    if freedom <= 0 or not dimensions:
        return 1.0
    if fraction >= 1.0:
        return 0.0
    ratio = (fraction / dimensions) / ((1.0 - fraction) / freedom)
    return float(fdtrc(dimensions, freedom, max(0.0, ratio)))


def _image(scene: ResidualScene) -> Basis:
    x, y = scene.observations.pixels.numpy().T
    cell = np.floor(x / scene.width * CELLS[0]).clip(0, CELLS[0] - 1) * CELLS[1] + np.floor(
        y / scene.height * CELLS[1]
    ).clip(0, CELLS[1] - 1)
    return _group_means(cell)


def _board(scene: ResidualScene) -> Basis:
    _, corner = np.unique(scene.observations.corners.numpy().round(9), axis=0, return_inverse=True)
    return _group_means(corner.ravel())


def _motion(scene: ResidualScene) -> Basis:
    """Terms linear and quadratic in the row, for each view."""
    view = scene.observations.view.numpy()
    row = scene.observations.pixels.numpy()[:, 1]
    offset = (row - (np.bincount(view, row) / np.bincount(view).clip(1))[view]) / scene.height
    return view, np.stack([offset, offset**2], -1)


def _time(scene: ResidualScene) -> Basis:
    """Terms in time, uniform or proportional to the distance from the image centre."""
    observations = scene.observations
    time = (
        observations.view.numpy() / max(1, len(observations.names) - 1)
        if observations.exposure is None
        else observations.exposure.time.numpy() + 0.5
    ) - 0.5
    x, y = (observations.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    return _one_group(time, time * x, time * y, time**2, time**2 * x, time**2 * y)


def _refraction(scene: ResidualScene) -> Basis:
    """Terms towards the image centre, by incidence and inverse distance."""
    near = 1 / scene.distance
    bend = 1 - scene.incidence
    x, y = (scene.observations.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    smooth = [bend**i * near**j for i in range(3) for j in range(3)]
    return _one_group(*(polynomial * coordinate for polynomial in smooth for coordinate in (x, y)))


def _phase(scene: ResidualScene) -> Basis:
    x, y = 2 * np.pi * scene.observations.pixels.numpy().T
    return _one_group(np.sin(x), np.cos(x), np.sin(y), np.cos(y))


def _group_means(label: NDArray[np.generic]) -> Basis:
    """The mean of each group of integer labels."""
    return label.astype(np.int64), np.ones((len(label), 1))


def _one_group(*columns: Array) -> Basis:
    return np.zeros(len(columns[0]), np.int64), np.stack(columns, -1)


ORGANISERS: dict[str, Callable[[ResidualScene], Basis]] = {
    "image": _image,
    "board": _board,
    "row x motion": _motion,
    "view and time": _time,
    "incidence x depth": _refraction,
    "sub-pixel phase": _phase,
}


ORGANISER_WORDS = {
    "image": "the place in the picture",
    "board": "the place on the board",
    "row x motion": "the row of the picture and the motion of the board",
    "view and time": "time",
    "incidence x depth": "depth and the angle of incidence",
    "sub-pixel phase": "the place within a pixel",
}
"""What each of them is called in a sentence."""


def variance_shares(
    calibration: Calibration,
    model: CameraModel,
    joint: Estimate,
    observations: Observations,
    residuals: Residuals,
) -> list[VarianceShare]:
    """Return the shares of the variance of a fit's residuals."""
    visible = torch.isfinite(residuals.image).all(-1)
    corners = observations.select_rows(visible)
    path, values, exposure = model.path, joint.values, corners.exposure
    points = path.place(corners.corners, values, joint.poses[corners.view], exposure)
    rays = path.trace(corners.pixels, values, exposure)
    pinhole = path.lens(*path.adjust_pixels(corners.pixels, values, exposure)).direction
    incidence = pinhole.dot(rays.direction) if model.path.cover else pinhole.z
    scene = ResidualScene(
        observations=corners,
        residual=residuals.image[visible].numpy(),
        distance=model.path.distance(points).numpy(),
        incidence=incidence.numpy(),
        width=calibration.camera.width,
        height=calibration.camera.height,
    )
    return scene.split()


def significant_shares(shares: Sequence[VarianceShare]) -> list[VarianceShare]:
    """Return the shares that noise does not explain."""
    return [
        share
        for share in shares
        if share.p_value < MAX_P_VALUE / len(shares)
        and share.fraction - share.chance > MIN_FRACTION
    ]
