"""The grey values in the raw buffers of V4L2 cameras."""

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]


def _plane(raw: Grey, width: int, height: int) -> Grey:
    return raw.reshape(-1)[: width * height].reshape(height, width)


def _decode(raw: Grey, _width: int, _height: int) -> Grey | None:
    grey = cv2.imdecode(raw.reshape(-1), cv2.IMREAD_GRAYSCALE)
    return None if grey is None else np.asarray(grey, np.uint8)


FORMATS: Mapping[str, Callable[[Grey, int, int], Grey | None]] = {
    "GREY": _plane,
    "YUYV": lambda raw, width, height: raw.reshape(height, width, 2)[..., 0],
    "UYVY": lambda raw, width, height: raw.reshape(height, width, 2)[..., 1],
    "NV12": _plane,
    "YU12": _plane,
    "MJPG": _decode,
}
"""The functions that take the (height, width) grey values from a raw buffer, the exact and cheap
formats first. They return None for a damaged JPEG.
"""
ROWS: Mapping[str, tuple[int, float]] = {
    "GREY": (1, 1),
    "YUYV": (2, 1),
    "UYVY": (2, 1),
    "NV12": (1, 1.5),
    "YU12": (1, 1.5),
}
"""The bytes of a pixel in a row of grey values, and the number of rows of that length per row of
the picture, chroma included. JPEGs have no rows.
"""
