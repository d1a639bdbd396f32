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

QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 62]


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


def data_url(pixels: Grey) -> str:
    """Return a picture as the JPEG data URL of an HTML image."""
    return (
        "data:image/jpeg;base64,"
        + b64encode(cv2.imencode(".jpg", pixels, QUALITY)[1].tobytes()).decode()
    )


def _read_shrunk(path: Path, full_width: int, width: int) -> tuple[NDArray, int]:
    """Return grey pixels and the factor by which they are shrunk. A large JPEG is decoded at an
    eighth of its size, in a fraction of the time.
    """
    if full_width > 8 * width and (data := read_file(path)).startswith(JPEG):
        flags = cv2.IMREAD_REDUCED_GRAYSCALE_8 | cv2.IMREAD_IGNORE_ORIENTATION
        return decode_picture(data, flags), 8
    return read_grey(path), 1
