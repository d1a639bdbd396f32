"""The grey values and the colours in the raw buffers of V4L2 cameras."""

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Picture = NDArray[np.uint8]


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


def _decode_colour(raw: Grey, _width: int, _height: int) -> Picture | None:
    picture = cv2.imdecode(raw.reshape(-1), cv2.IMREAD_COLOR)
    return None if picture is None else np.asarray(picture, np.uint8)


def _packed(code: int) -> Callable[[Grey, int, int], Picture]:
    """Return the conversion of two bytes for a pixel."""
    return lambda raw, width, height: np.asarray(
        cv2.cvtColor(raw.reshape(height, width, 2), code), np.uint8
    )


def _planar(code: int) -> Callable[[Grey, int, int], Picture]:
    """Return the conversion of a plane of brightness, and colours of half its width and height."""

    def convert(raw: Grey, width: int, height: int) -> Picture:
        planes = raw.reshape(-1)[: width * height * 3 // 2].reshape(-1, width)
        return np.asarray(cv2.cvtColor(planes, code), np.uint8)

    return convert


COLOURS: Mapping[str, Callable[[Grey, int, int], Picture | None]] = {
    "YUYV": _packed(cv2.COLOR_YUV2BGR_YUYV),
    "UYVY": _packed(cv2.COLOR_YUV2BGR_UYVY),
    "NV12": _planar(cv2.COLOR_YUV2BGR_NV12),
    "YU12": _planar(cv2.COLOR_YUV2BGR_I420),
    "MJPG": _decode_colour,
}
"""The functions that make the (height, width, 3) BGR picture of a raw buffer. Formats without
colours are missing.
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
