"""The rays of a calibrated camera, sampled over its image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError

Array = NDArray[np.float64]

FIT_GRID = (64, 48)
"""Pixels across and down, from edge to edge, to which a model is fitted."""
CHECK_GRID = (2 * FIT_GRID[0] - 1, 2 * FIT_GRID[1] - 1)
"""Pixels at which the misfit is measured: the fitted ones and those midway between, where a model
with many parameters could hide its errors.
"""
MIN_Z = 0.05
"""z of a unit ray: no pinhole with a lens can represent rays that leave the cover flatter than
this, 3 degrees from sideways.
"""
MIN_FRACTION = 0.25
"""Part of the grid that must see through the cover."""


@dataclass(frozen=True, slots=True)
class SampledRays:
    """The rays of N pixels; pixels without a ray are left out."""

    pixels: Array
    """(N, 2) px"""
    foot: Array
    """(N, 2) m: where each ray, extended backwards if necessary, passes the plane z = 0."""
    tangent: Array
    """(N, 2) dx/dz and dy/dz."""
    exit_depth: float
    """m: the largest z at which a ray leaves the cover."""
    angle_limit: float | None
    """rad from the axis, the largest angle of these rays; None if the camera sees nothing beyond
    it.
    """

    @staticmethod
    def sample(calibration: Calibration, grid: tuple[int, int]) -> SampledRays:
        """Sample a grid of pixels, columns and rows; raise InputError if too few see through the
        cover.
        """
        sizes = calibration.camera.width, calibration.camera.height
        axes = (np.linspace(0, size - 1, count) for size, count in zip(sizes, grid, strict=True))
        pixels = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
        origins, directions = calibration.rays(pixels)
        usable = directions[:, 2] > MIN_Z  # false for NaN
        if np.count_nonzero(usable) < MIN_FRACTION * len(usable):
            raise InputError(
                "Too little of the image sees through the cover to fit a central camera: use"
                " --format npz, opencv or stmap."
            )
        sees_beyond = bool((directions[~usable, 2] <= MIN_Z).any())  # false for NaN
        origins, directions = origins[usable], directions[usable]
        tangent = directions[:, :2] / directions[:, 2:]
        return SampledRays(
            pixels=pixels[usable],
            foot=origins[:, :2] - tangent * origins[:, 2:],
            tangent=tangent,
            exit_depth=float(origins[:, 2].max()),
            angle_limit=float(np.arccos(directions[:, 2].min())) if sees_beyond else None,
        )

    def nearly_intersect(self) -> Array:
        """Return the (3,) m point that is nearest to the rays in the root mean square, measured in
        its plane z = const.
        """
        constant = np.ones(len(self.foot))
        zeros = np.zeros(len(self.foot))
        rows_x = np.column_stack([constant, zeros, -self.tangent[:, 0]])
        rows_y = np.column_stack([zeros, constant, -self.tangent[:, 1]])
        return np.asarray(
            np.linalg.lstsq(np.vstack([rows_x, rows_y]), self.foot.T.ravel(), rcond=None)[0]
        )

    def tangents(self, depth: float, centre: Array) -> Array:
        """Return (N, 2) x / z and y / z, as seen from the (3,) m centre, of the points that the
        pixels see at this depth in m; the depth may be infinite.
        """
        if math.isinf(depth):
            return self.tangent
        return np.asarray((self.foot + self.tangent * depth - centre[:2]) / (depth - centre[2]))
