"""How the board's squares are lit: whether white is cut off, and how far it is from black."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board

FULL = 254  # grey levels: a sensor's end of 255, less what JPEG changes
VIDEO_FULL = 235  # where cameras end that keep to the levels of television
INSIDE = np.linspace(0.3, 0.7, 5)  # of a square, clear of its edges


@dataclass(frozen=True, slots=True)
class Exposure:
    clipped: float
    """Share of the white squares' area where more light would change nothing."""
    contrast: float
    """Grey levels between neighbouring squares where it is least, but for the worst tenth."""


def measure_exposure(
    grey: NDArray[np.uint8], corners: NDArray[np.float64], board: Board
) -> Exposure:
    """Of the squares between the (count, 2) px corners of a (H, W) picture."""
    grid = corners.reshape(board.rows, board.columns, 1, 2)
    x, y = (part.reshape(-1, 1) for part in np.meshgrid(INSIDE, INSIDE))
    places = (1 - y) * ((1 - x) * grid[:-1, :-1] + x * grid[:-1, 1:]) + y * (
        (1 - x) * grid[1:, :-1] + x * grid[1:, 1:]
    )
    flat = places.reshape(len(places), -1, 2).astype(np.float32)
    light = np.asarray(cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_NEAREST)).reshape(
        places.shape[:-1]
    )
    mean = light.mean(-1)
    odd = np.add.outer(*(np.arange(size) for size in mean.shape)) % 2 == 1
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
    return Exposure(clipped, float(np.percentile(steps, 10)))
