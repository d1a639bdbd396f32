"""How far a screen has moved in a camera's picture, between two photographs of one pattern."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SMOOTHING = 1.5
"""px, the blur (standard deviation) before slopes are taken: it averages noise."""
MAX_PIXELS = 40_000
"""Pixels that are compared; the noise of their common motion is below 0.001 px."""
MIN_SLOPE = 1.0
"""Grey levels in a px, below which a pixel tells nothing."""


def measure_motion(
    first: NDArray[np.uint8], second: NDArray[np.uint8], lit: NDArray[np.bool_]
) -> float:
    """Return the motion in px between two (H, W) grey pictures, root mean square over the screen.

    It is to first order, and so right where it is small; a large one is only told to be large. A
    change of the light (a factor and an offset) is no motion.

    Args:
        lit: (H, W) true for the pixels that see the screen.
    """
    smooth_first = cv2.GaussianBlur(first.astype(np.float64), (0, 0), SMOOTHING)
    smooth_second = cv2.GaussianBlur(second.astype(np.float64), (0, 0), SMOOTHING)
    mean = (smooth_first + smooth_second) / 2
    by_v: Floats = np.asarray(np.gradient(mean, axis=0))
    by_u: Floats = np.asarray(np.gradient(mean, axis=1))
    usable = cv2.erode(lit.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    usable &= np.hypot(by_u, by_v) > MIN_SLOPE
    rows, columns = np.nonzero(usable)
    if len(rows) < 100:
        return float("inf")
    step = 1 + len(rows) // MAX_PIXELS
    rows, columns = rows[::step], columns[::step]
    height, width = first.shape
    x, y = 2 * columns / width - 1, 2 * rows / height - 1
    affine = np.stack([np.ones_like(x), x, y], -1)
    slopes = by_u[rows, columns], by_v[rows, columns]
    level = smooth_first[rows, columns]
    terms = np.column_stack(
        [slopes[0][:, None] * affine, slopes[1][:, None] * affine, np.ones_like(level), level]
    )
    change = level - smooth_second[rows, columns]
    solution = np.linalg.lstsq(terms, change, rcond=None)[0]
    moved = np.stack([affine @ solution[:3], affine @ solution[3:6]], -1)
    unexplained = np.std(change - terms @ solution) / max(float(np.std(level)), 1e-9)
    shift = float(np.sqrt((moved**2).sum(-1).mean()))
    return max(shift, 1.0) if unexplained > 0.5 else shift
