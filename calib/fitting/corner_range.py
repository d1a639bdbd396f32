"""The pixels and distances at which a calibration has corners: elsewhere it extrapolates."""

import math

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.optics.exposure import MIDDLE

CELLS = (16, 12)
"""Columns and rows of the cells of the picture in which corners are counted."""
DEPTH_MARGIN = 0.5
"""The margin on both sides of the corners' inverse depths, relative to their span. A pixel's ray is
the same at every depth, so its undistorted place is a straight line over inverse depth; the
standard deviation of a line that was fitted to evenly spread points is, half a span beyond their
ends, 1.8 times what it is at the ends.
"""

Array = NDArray[np.float64]


def covered_fraction(calibration: Calibration, pixels: Array) -> float:
    """Return the fraction of the picture's cells that have corners, 0 to 1.

    A cell without corners counts only if its middle sees forward. The border of a wide lens's
    picture is unknown, and no undistorted picture holds what lies beside the camera.

    Args:
        pixels: (N, 2) px, the corners.
    """
    sizes = np.array([calibration.camera.width, calibration.camera.height])
    cell = ((pixels + 0.5) / sizes * CELLS).astype(np.int64)
    column, row = np.clip(cell, 0, np.array(CELLS) - 1).T
    has_corners = np.zeros(CELLS, dtype=np.bool_)
    has_corners[column, row] = True
    path, values = calibration.model()
    forward = np.ones(CELLS, dtype=np.bool_)
    if path.lens.wide:
        centres = np.stack(np.meshgrid(*map(np.arange, CELLS), indexing="ij"), -1) + 0.5
        middles = torch.from_numpy(centres * sizes / CELLS - 0.5)
        forward = path.trace(middles, values, MIDDLE).in_pinhole.numpy()
    return float(has_corners.sum() / (has_corners | forward).sum())


def corner_points(calibration: Calibration) -> Array:
    """Return (M, 3) m, the corners of the fitted views in the camera frame."""
    path, values = calibration.model()
    observations = calibration.observations
    poses = torch.from_numpy(calibration.poses)[observations.view]
    return np.asarray(
        path.place(observations.corners, values, poses, observations.exposure).numpy()
    )


def corners_at(calibration: Calibration) -> Array:
    """Return (N, 3): x and y in px of the training corners, and their distance in m
    (`Path.distance`).
    """
    if not calibration.views:
        return calibration.corners_at
    path, _ = calibration.model()
    distance = path.distance(torch.from_numpy(corner_points(calibration)))
    return np.column_stack([calibration.observations.pixels.numpy(), distance.numpy()])


def distance_range(distance: Array) -> tuple[float, float]:
    """Return the distances in m of the nearest and the farthest of some corners. A corner behind a
    lens that is not wide does not count, as the model does not see it, unless all are there.

    Args:
        distance: (N,) m, as `Path.distance` gives it.
    """
    ahead = distance > 0
    counted = distance[ahead | ~ahead.any()]
    return float(counted.min()), float(counted.max())


def trusted_depths(near: float, far: float) -> tuple[float, float]:
    """Return the range of depths in m that corners from near to far support."""
    margin = DEPTH_MARGIN * (1 / near - 1 / far)
    return 1 / (1 / near + margin), 1 / (1 / far - margin) if 1 / far > margin else math.inf


def describe_trusted(near: float, far: float) -> str:
    """Return the range of `trusted_depths` in words."""
    nearest, farthest = trusted_depths(near, far)
    return (
        f"{nearest:.2g} m and more"
        if math.isinf(farthest)
        else f"{nearest:.2g} to {farthest:.2g} m"
    )
