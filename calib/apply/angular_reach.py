"""The largest angle from the axis that a wide lens sees, and the angle at which its undistorted
picture ends. An undistorted picture is that of a pinhole, which ends before 90 degrees.
"""

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.fitting.corner_range import corners_at
from calib.optics.rays import FLATTEST

GRID = (65, 49)
"""Columns and rows of the sampled pixels, from border to border."""


def undistortion_limit(calibration: Calibration) -> str:
    """Return a sentence on the angle at which undistorted pictures end; an empty text if a pinhole
    can see everything that the lens sees.
    """
    if not calibration.model()[0].lens.wide:
        return ""
    columns = np.linspace(0, calibration.camera.width - 1, GRID[0])
    rows = np.linspace(0, calibration.camera.height - 1, GRID[1])
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    if _largest_angle(calibration, pixels) < np.degrees(np.arccos(FLATTEST)):
        return ""
    corner_angle = _largest_angle(calibration, corners_at(calibration)[:, :2])
    edge_angle = _largest_angle(calibration, pixels[calibration.ray_field().holds(pixels)])
    return (
        "Some pixels see more than 90 degrees away from the axis, and corners were seen up to"
        f" {corner_angle:.0f} degrees away. An undistorted picture is a pinhole's, which ends"
        " before 90 degrees. At the camera's own focal length, it ends at"
        f" {edge_angle:.0f} degrees."
    )


def _largest_angle(calibration: Calibration, pixels: NDArray[np.float64]) -> float:
    """Return the largest angle in degrees between the axis and the rays of (N, 2) px; 0 if there is
    no ray.
    """
    _, directions = calibration.rays(pixels)
    angles = np.arccos(np.clip(directions[:, 2], -1, 1))
    return float(np.degrees(np.max(angles[np.isfinite(angles)], initial=0.0)))
