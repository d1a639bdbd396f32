"""The session's own pictures, small, inside the page."""

from base64 import b64encode
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import RefracalError
from calib.io.encoded_picture import JPEG, decode_picture
from calib.io.files import read_file
from calib.io.images import read_grey

Grey = NDArray[np.uint8]

QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 62]


def picture_of(session: Path, view: str) -> Path:
    """Where a view's picture would be."""
    return session / "frames" / Path(view).name


def read_small(path: Path, size: tuple[int, int], width: int) -> Grey | None:
    """A picture shrunk to a width in px; None where it can not be read any more, or is not of this
    size.
    """
    try:
        pixels, shrunk = _read(path, size[0], width)
    except (RefracalError, OSError, ValueError):
        return None
    whole = tuple(-(-length // shrunk) for length in size)
    if pixels.shape != whole[::-1]:
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
    return (
        "data:image/jpeg;base64,"
        + b64encode(cv2.imencode(".jpg", pixels, QUALITY)[1].tobytes()).decode()
    )


def _read(path: Path, whole: int, width: int) -> tuple[NDArray, int]:
    """Grey pixels, and by how much they are shrunk: a large JPEG is decoded at an eighth of its
    size, in a fraction of the time.
    """
    if whole > 8 * width and (data := read_file(path)).startswith(JPEG):
        flags = cv2.IMREAD_REDUCED_GRAYSCALE_8 | cv2.IMREAD_IGNORE_ORIENTATION
        return decode_picture(data, flags), 8
    return read_grey(path), 1
