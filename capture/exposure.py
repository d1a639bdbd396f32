"""The lighting of the board's squares: the saturation of white and its contrast to black."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board

FULL = 254  # grey levels: a sensor's maximum of 255, less the change that JPEG makes
VIDEO_FULL = 235  # grey levels: the maximum of cameras that keep to the range of television
SQUARE_INTERIOR = np.linspace(0.3, 0.7, 5)  # fraction of a square's side, clear of its edges


@dataclass(frozen=True, slots=True)
class SquareLighting:
    clipped: float
    """The fraction of the white squares' area that is saturated."""
    contrast: float
    """The 10th percentile of the difference between neighbouring squares, in grey levels."""


def measure_exposure(
    grey: NDArray[np.uint8], corners: NDArray[np.float64], board: Board
) -> SquareLighting:
    """Return the exposure of the squares between the (count, 2) px corners of a (H, W) picture."""
    grid = corners.reshape(board.rows, board.columns, 1, 2)
    x = np.tile(SQUARE_INTERIOR, len(SQUARE_INTERIOR))[:, None]
    y = np.repeat(SQUARE_INTERIOR, len(SQUARE_INTERIOR))[:, None]
    places = (1 - y) * ((1 - x) * grid[:-1, :-1] + x * grid[:-1, 1:]) + y * (
        (1 - x) * grid[1:, :-1] + x * grid[1:, 1:]
    )
    flat = places.reshape(len(places), -1, 2).astype(np.float32)
    light = np.asarray(cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_NEAREST)).reshape(
        places.shape[:-1]
    )
    mean = light.mean(-1)
    odd = np.add.outer(np.arange(mean.shape[0]), np.arange(mean.shape[1])) % 2 == 1
    white = odd == (mean[odd].mean() > mean[~odd].mean())
    sign = np.where(white, 1.0, -1.0)
    steps = np.concatenate(
        [
            ((mean[:-1] - mean[1:]) * sign[:-1]).ravel(),
            ((mean[:, :-1] - mean[:, 1:]) * sign[:, :-1]).ravel(),
        ]
    )
    brightest = int(light.max())
    clipped = (
        float((light[white] >= min(brightest, FULL)).mean()) if brightest >= VIDEO_FULL else 0.0
    )
    return SquareLighting(clipped, float(np.percentile(steps, 10)))
