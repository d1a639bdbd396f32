"""The pixels and distances at which a calibration has corners: elsewhere it extrapolates."""

from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.estimation.residuals import Residuals, residuals
from calib.optics.exposure import MIDDLE

CELLS = (16, 12)
"""Columns and rows of the cells of the picture in which corners are counted."""
MANY_EMPTY = 1 / 3
"""The fraction of a part's cells without corners, above which the part is named."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def covered_fraction(calibration: Calibration, pixels: Array) -> float:
    """Return the fraction of the picture's cells that have corners, 0 to 1.

    Args:
        pixels: (N, 2) px, the corners.
    """
    has_corners, counted = _cells(calibration, pixels)
    return float(has_corners.sum() / counted.sum())


def emptiest_region(calibration: Calibration, pixels: Array) -> str:
    """Return the part of the picture with the most cells without corners, in words; an empty text
    if no part has many.

    Args:
        pixels: (N, 2) px, the corners.
    """
    has_corners, counted = _cells(calibration, pixels)
    thirds = [np.array_split(np.arange(count), 3) for count in CELLS]
    empty = {
        (column, row): float((~has_corners & counted)[np.ix_(xs, ys)].sum() / len(xs) / len(ys))
        for column, xs in enumerate(thirds[0])
        for row, ys in enumerate(thirds[1])
    }
    column, row = max(empty, key=empty.__getitem__)
    if empty[column, row] <= MANY_EMPTY:
        return ""
    return picture_region((column + 0.5) / 3, (row + 0.5) / 3)


def picture_region(x: float, y: float) -> str:
    """Return words for a place in the picture, whose coordinates are 0 to 1."""
    rows, columns = ("top", "", "bottom"), ("left", "", "right")
    row, column = rows[_third(y)], columns[_third(x)]
    if not (row or column):
        return "in the middle"
    if not (row and column):
        return f"at the {row}" if row else f"at the {column} edge"
    return f"at the {row} {column}"


def _third(fraction: float) -> int:
    return min(max(int(3 * fraction), 0), 2)


def _cells(calibration: Calibration, pixels: Array) -> tuple[Mask, Mask]:
    """Return two arrays of CELLS: true where a cell has corners, and where it counts.

    A cell without corners counts only if its middle sees forward. The border of a wide lens's
    picture is unknown, and no undistorted picture holds what lies beside the camera.
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
    return has_corners, has_corners | forward


@lru_cache(maxsize=1)  # a report and its verdict ask several times
def corner_points(calibration: Calibration) -> Array:
    """Return (M, 3) m, the corners of the fitted views in the camera frame."""
    path, values = calibration.model()
    observations = calibration.observations
    poses = torch.from_numpy(calibration.poses)[observations.view]
    return np.asarray(
        path.place(observations.corners, values, poses, observations.exposure).numpy()
    )


@lru_cache(maxsize=1)  # a report and its verdict both ask
def corner_residuals(calibration: Calibration) -> Residuals:
    """Return the residuals of the M corners of the fitted views."""
    path, values = calibration.model()
    return residuals(path, values, calibration.observations, torch.from_numpy(calibration.poses))


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
