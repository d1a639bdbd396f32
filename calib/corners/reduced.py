"""A picture reduced by a whole number, in which a board is looked for quickly."""

import cv2
import numpy as np
from numpy.typing import NDArray

LIVE = 960  # px, the longer side of the picture searched, at most


def live_factor(grey: NDArray[np.uint8]) -> int:
    """By how much a picture is to be reduced, so that it is no longer than LIVE."""
    height, width = grey.shape
    return int(min(-(-max(height, width) // LIVE), height, width))


def reduced(picture: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """A picture, grey or in colours, in blocks of factor x factor px, which is ten times faster
    than any other ratio; what is left at the end is dropped.
    """
    if factor == 1:
        return np.ascontiguousarray(picture)
    height, width = (size // factor for size in picture.shape[:2])
    return np.asarray(
        cv2.resize(
            picture[: height * factor, : width * factor],
            (width, height),
            interpolation=cv2.INTER_AREA,
        ),
        np.uint8,
    )


def enlarged(corners: NDArray, factor: float) -> NDArray[np.float64]:
    """(..., 2) px of the whole picture from those of the reduced one."""
    return np.asarray((corners + 0.5) * factor - 0.5)
