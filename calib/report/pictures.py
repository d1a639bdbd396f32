"""Thumbnails of the session's pictures, embedded in the page."""

from base64 import b64encode
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import RefracalError
from calib.io.encoded_picture import JPEG, decode_picture
from calib.io.files import read_file
from calib.io.images import frames_folder, read_grey

Grey = NDArray[np.uint8]

REDUCED = {
    8: cv2.IMREAD_REDUCED_GRAYSCALE_8,
    4: cv2.IMREAD_REDUCED_GRAYSCALE_4,
    2: cv2.IMREAD_REDUCED_GRAYSCALE_2,
}
"""OpenCV's flag for each factor by which a JPEG is shrunk as it is decoded."""
QUALITY, LOW_QUALITY = 62, 38


def picture_of(session: Path, view: str) -> Path:
    """Return the path of a view's picture, which may not exist."""
    return frames_folder(session) / Path(view).name


def read_small(path: Path, size: tuple[int, int], width: int) -> Grey | None:
    """Return a picture shrunk to a width in px; None if it cannot be read or has another size."""
    try:
        pixels, shrunk = _read_shrunk(path, size[0], width)
    except (RefracalError, OSError, ValueError):
        return None
    expected = tuple(-(-length // shrunk) for length in size)
    if pixels.shape != expected[::-1]:
        return None
    return np.asarray(
        cv2.resize(
            eight_bits(pixels),
            (width, round(width * size[1] / size[0])),
            interpolation=cv2.INTER_AREA,
        ),
        np.uint8,
    )


def data_url(pixels: Grey, max_bytes: int) -> str:
    """Return a picture as the JPEG data URL of an HTML image. Grain makes large files: a picture
    that would take more than `max_bytes` is compressed more, then shrunk until it does not.
    """
    data = _jpeg(pixels, QUALITY)
    if len(data) > max_bytes:
        data = _jpeg(pixels, LOW_QUALITY)
    while len(data) > max_bytes:
        scale = 0.95 * (max_bytes / len(data)) ** 0.5
        pixels = np.asarray(
            cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
        )
        data = _jpeg(pixels, LOW_QUALITY)
    return "data:image/jpeg;base64," + b64encode(data).decode()


def _jpeg(pixels: Grey, quality: int) -> bytes:
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def _read_shrunk(path: Path, full_width: int, width: int) -> tuple[NDArray, int]:
    """Return grey pixels and the factor by which they are shrunk. A JPEG is decoded at an eighth, a
    quarter or a half of its size where that is enough, in a fraction of the time.
    """
    factor = next((factor for factor in REDUCED if full_width > factor * width), 1)
    if factor > 1 and (data := read_file(path)).startswith(JPEG):
        flags = REDUCED[factor] | cv2.IMREAD_IGNORE_ORIENTATION
        return decode_picture(data, flags), factor
    return read_grey(path), 1
