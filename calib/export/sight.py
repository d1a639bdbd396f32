"""What a calibrated camera sees over its image, as straight lines in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError

Array = NDArray[np.float64]

FITTED = (64, 48)
"""Pixels across and down, from edge to edge, that a model is fitted to."""
CHECKED = (2 * FITTED[0] - 1, 2 * FITTED[1] - 1)
"""Those that its misfit is measured at: these, and those halfway between, where a model of many
numbers could hide its errors.
"""
FLATTEST = 0.05
"""z of a unit ray: what leaves the cover flatter than this, 3 degrees from sideways, no pinhole
with a lens can follow.
"""
FEWEST = 0.25
"""Of the grid: the least that must see through the cover."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The rays of N pixels, all that have one."""

    pixels: Array
    """(N, 2) px"""
    foot: Array
    """(N, 2) m: where each ray, carried back if need be, passes the plane z = 0."""
    tangent: Array
    """(N, 2) dx/dz and dy/dz"""
    beyond: float
    """m: the largest z at which a ray leaves the cover."""
    limit: float | None
    """rad from the axis: the largest angle of these rays, if the camera sees flatter ones, too."""

    @staticmethod
    def of(calibration: Calibration, grid: tuple[int, int]) -> Sight:
        sizes = calibration.camera.width, calibration.camera.height
        axes = (np.linspace(0, size - 1, count) for size, count in zip(sizes, grid, strict=True))
        pixels = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
        origins, directions = calibration.rays(pixels)
        kept = directions[:, 2] > FLATTEST  # false for NaN
        if np.count_nonzero(kept) < FEWEST * len(kept):
            raise InputError(
                "Too little of the image sees through the cover to fit a central camera: use"
                " --format npz, opencv or stmap."
            )
        flatter = bool((directions[~kept, 2] <= FLATTEST).any())
        origins, directions = origins[kept], directions[kept]
        tangent = directions[:, :2] / directions[:, 2:]
        return Sight(
            pixels[kept],
            origins[:, :2] - tangent * origins[:, 2:],
            tangent,
            float(origins[:, 2].max()),
            float(np.arccos(directions[:, 2].min())) if flatter else None,
        )

    def nearly_intersect(self) -> Array:
        """(3,) m: the point to which the rays, where they pass its plane z = const, are nearest in
        the root mean square.
        """
        ones, zeros = np.ones(len(self.foot)), np.zeros(len(self.foot))
        rows_x = np.column_stack([ones, zeros, -self.tangent[:, 0]])
        rows_y = np.column_stack([zeros, ones, -self.tangent[:, 1]])
        return np.asarray(
            np.linalg.lstsq(np.vstack([rows_x, rows_y]), self.foot.T.ravel(), rcond=None)[0]
        )

    def tangents(self, depth: float, centre: Array) -> Array:
        """(N, 2) x / z and y / z, seen from the centre (3,) m, of what each pixel sees at depth m;
        infinity is a depth.
        """
        if math.isinf(depth):
            return self.tangent
        return np.asarray((self.foot + self.tangent * depth - centre[:2]) / (depth - centre[2]))
