"""How far from its axis a wide lens sees, and how much of that an undistorted picture shows: a
pinhole's picture, which ends before 90 degrees.
"""

import numpy as np
from numpy.typing import NDArray

from calib.apply.map_uncertainty import corners_at
from calib.calibration import Calibration
from calib.optics.rays import FLATTEST

GRID = (65, 49)
"""Pixels across and down, from border to border, that are asked."""


def undistortion_limit(calibration: Calibration) -> str:
    """A sentence on the angle at which undistorted pictures end, if the lens sees what none of them
    holds; else nothing.
    """
    if not calibration.model()[0].lens.wide:
        return ""
    sizes = calibration.camera.width, calibration.camera.height
    axes = [np.linspace(0, size - 1, count) for size, count in zip(sizes, GRID, strict=True)]
    pixels = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    if _largest_angle(calibration, pixels) < np.degrees(np.arccos(FLATTEST)):
        return ""
    corners = _largest_angle(calibration, corners_at(calibration)[:, :2])
    edge = _largest_angle(calibration, pixels[calibration.ray_field().holds(pixels)])
    return (
        "Some pixels see more than 90 degrees away from the axis, and corners were seen up to"
        f" {corners:.0f} degrees away. An undistorted picture is a pinhole's, which ends before 90"
        f" degrees: at the camera's own focal length, at {edge:.0f}."
    )


def _largest_angle(calibration: Calibration, pixels: NDArray[np.float64]) -> float:
    """Degrees between the rays of (N, 2) px and the axis, at most; 0 without any ray."""
    _, directions = calibration.rays(pixels)
    angles = np.arccos(np.clip(directions[:, 2], -1, 1))
    return float(np.degrees(np.max(angles[np.isfinite(angles)], initial=0.0)))
