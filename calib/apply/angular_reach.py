"""How far from its axis a lens sees, and how much of that an undistorted picture holds: a pinhole's
picture, which ends before 90 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.optics.rays import FLATTEST

GRID = (65, 49)
"""Pixels across and down, from border to border, that are asked."""


@dataclass(frozen=True, slots=True)
class AngularReach:
    """Angles from the axis, in degrees, of what a camera sees."""

    lens: float
    """The largest one anywhere in the picture."""
    picture: float
    """The largest one that the undistorted picture of the camera's own focal length holds."""

    @property
    def beyond_pinhole(self) -> bool:
        """True if the camera sees what no undistorted picture holds."""
        return self.lens >= np.degrees(np.arccos(FLATTEST))

    @property
    def sentence(self) -> str:
        """How far the undistorted picture reaches; empty where it can hold all that is seen."""
        if not self.beyond_pinhole:
            return ""
        return (
            f"The lens sees up to {self.lens:.0f} degrees from its axis. An undistorted picture is"
            f" a pinhole's and ends before 90: with the camera's own focal length, at"
            f" {self.picture:.0f} degrees."
        )


def angular_reach(calibration: Calibration) -> AngularReach:
    """Of a calibrated camera, on a grid over its picture."""
    sizes = calibration.camera.width, calibration.camera.height
    axes = [np.linspace(0, size - 1, count) for size, count in zip(sizes, GRID, strict=True)]
    pixels = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    _, directions = calibration.rays(pixels)
    angles = np.degrees(np.arccos(np.clip(directions[:, 2], -1, 1)))
    held = calibration.ray_field().holds(pixels)
    return AngularReach(_largest(angles), _largest(angles[held]))


def _largest(angles: NDArray[np.float64]) -> float:
    """0 where there is none."""
    return float(np.max(angles[np.isfinite(angles)], initial=0.0))
