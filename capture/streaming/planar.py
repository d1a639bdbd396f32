"""Pictures in the format of videos: a plane of brightness, and two planes of colour of half its
width and height (I420), BT.601 with the range 16 to 235.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

NEUTRAL = 128
"""The value of both colours in a grey picture."""
GREY_TO_Y = np.round(16 + np.arange(256) * 219 / 255).astype(np.uint8)
"""The brightness of each grey level."""


class PlanarConverter:
    """A converter for pictures of one size, which reuses its buffer."""

    def __init__(self, width: int, height: int) -> None:
        """`width` and `height` are in px, and even."""
        self._planes: NDArray[np.uint8] = np.full((height * 3 // 2, width), NEUTRAL, np.uint8)
        self._height = height

    def convert(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return (h * 3 / 2, w): the three planes one after the other. The next call overwrites it.

        Args:
            picture: (h, w) grey or (h, w, 3) BGR.
        """
        if picture.ndim == 3:
            cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420, self._planes)
        else:
            cv2.LUT(picture, GREY_TO_Y, self._planes[: self._height])
            self._planes[self._height :] = NEUTRAL
        return self._planes
