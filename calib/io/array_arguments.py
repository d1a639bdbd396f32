"""Check the arguments of the library's calls. An array or number of any type becomes contiguous
float64, or an InputError says what was expected and what was given.

Coordinates that are not finite are no mistake: the library itself returns NaN where a camera sees
nothing, and accepts it as input.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError, WrongTypeError, brief, wrong_type
from calib.io.numerals import real_number

Array = NDArray[np.float64]

FARTHEST_PX = 1e9
"""px: a larger coordinate is on no picture. The square and the cube of this one are still finite.
"""
FARTHEST_M = 1e12
"""m: a larger distance gives the same pixel as infinity, to the last digit."""
PICTURE_TYPES = tuple(np.dtype(kind) for kind in ("u1", "u2", "i2", "f4", "f8"))
"""The types of pixels that cv2.remap takes."""


def numbers(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """Return the values as contiguous float64.

    Args:
        values: real numbers of any type; an empty list stands for no rows.
        shape: the expected shape; None for any length.
        name: the argument's name, for the message.

    Raises:
        WrongTypeError: the values are not real numbers.
        InputError: they have another shape.
    """
    array = as_array(values, name)
    if array.dtype.kind not in "fiub":
        raise WrongTypeError(
            f"{name} is not an array of real numbers: give it as {_shape_text(shape)}."
        )
    if array.size == 0 and array.ndim == 1 and shape[0] is None:
        array = array.reshape(0, *(length or 0 for length in shape[1:]))
    if array.ndim != len(shape) or any(
        expected not in (None, length) for expected, length in zip(shape, array.shape, strict=True)
    ):
        raise InputError(
            f"{name} has shape {_shape_text(array.shape)} where {_shape_text(shape)} is expected."
        )
    with np.errstate(all="ignore"):  # a long double may be too large
        converted = np.ascontiguousarray(array, dtype=np.float64)
    return converted if converted.flags.writeable else converted.copy()  # torch shares no other


def as_array(values: object, name: str) -> NDArray[Any]:
    """Return the value as an array of NumPy's choice of type; WrongTypeError if it is none."""
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError):  # of rows of different lengths, for one
        raise WrongTypeError(
            f"{name} is not an array: give rows of numbers, all of one length."
        ) from None


def one_of(value: object, allowed: Sequence[int], name: str) -> int:
    """Return the value as one of the allowed whole numbers; InputError if it is none of them."""
    for candidate in allowed:
        if real_number(value, name) == candidate:
            return candidate
    listed = ", ".join(map(str, allowed))
    raise InputError(f"{name} is {brief(repr(value))}: give one of {listed}.")


def pixel_rows(values: ArrayLike, name: str = "pixels") -> Array:
    """Return (N, 2) px; NaN in rows that are on no picture."""
    pixels = numbers(values, (None, 2), name)
    with np.errstate(invalid="ignore"):
        excluded = np.asarray(~(np.abs(pixels) < FARTHEST_PX).all(-1))
    if not excluded.any():
        return pixels
    return np.where(excluded[:, None], np.nan, pixels)


def point_rows(values: ArrayLike, name: str = "points") -> Array:
    """Return (N, 3) m. A point beyond FARTHEST_M is moved to that distance along its direction. A
    point that is not finite becomes NaN.
    """
    points = numbers(values, (None, 3), name)
    distance = np.abs(points).max(-1, keepdims=True, initial=0.0)
    if (distance <= FARTHEST_M).all():
        return points
    finite = np.isfinite(distance)
    far = finite & (distance > FARTHEST_M)
    direction = np.where(far, points, 0.0) / np.where(far, distance, 1.0)
    return np.where(finite, np.where(far, direction * FARTHEST_M, points), np.nan)


def row_numbers(values: ArrayLike, count: int, name: str) -> Array:
    """Return (count,) numbers: one for each row, or the same one for all rows."""
    if isinstance(values, int | float | np.generic) or getattr(values, "ndim", 1) == 0:
        return np.full(count, real_number(values, name))
    return numbers(values, (count,), name)


def indices(values: ArrayLike, count: int, limit: int, name: str) -> NDArray[np.intp]:
    """Return (count,) whole numbers from 0 to limit - 1."""
    rows = numbers(values, (count,), name)
    if not ((rows >= 0) & (rows < limit) & (np.floor(rows) == rows)).all():
        raise InputError(f"{name} must hold whole numbers, each from 0 on and less than {limit}.")
    return rows.astype(np.intp)


def picture(image: ArrayLike, width: int, height: int, name: str = "the picture") -> NDArray:
    """Return (height, width) or (height, width, channels) pixels, contiguous, in this machine's
    byte order, and of a type that OpenCV takes; InputError if the picture has another size or type.
    """
    if image is None or isinstance(image, str | PathLike):  # cv2.imread gives None for no picture
        raise wrong_type(name, image, "an array of pixels, such as cv2.imread gives of a picture")
    pixels = as_array(image, name)
    native = pixels.dtype.newbyteorder("=")
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and not 1 <= pixels.shape[2] <= 4):
        raise InputError(
            f"{name} has shape {_shape_text(pixels.shape)}: give (height, width) or (height, width,"
            " 3)."
        )
    if native not in PICTURE_TYPES:
        raise WrongTypeError(f"{name} has pixels of {pixels.dtype}: give uint8, uint16 or float32.")
    if pixels.shape[:2] != (height, width):
        raise InputError(
            f"{name} is {pixels.shape[1]}x{pixels.shape[0]} px where the calibration is for"
            f" {width}x{height}: give pictures of the calibrated camera mode."
        )
    return np.ascontiguousarray(pixels, dtype=native)


def on_finite_rows(
    function: Callable[[Array], tuple[Array, ...]], rows: Array, *widths: int
) -> tuple[Array, ...]:
    """Return the results of a function of (N, k) rows: one (N, width) array for each of the widths.
    The function gets only the rows that are finite. The other rows of the results are NaN.
    """
    finite = np.isfinite(rows).all(-1)
    if finite.all():
        return function(rows)
    results = tuple(np.full((len(rows), width), np.nan) for width in widths)
    for result, values in zip(results, function(rows[finite]), strict=True):
        result[finite] = values
    return results


def _shape_text(shape: tuple[int | None, ...]) -> str:
    """Return a shape as the documents write it, such as (N, 2)."""
    lengths = ["N" if length is None else str(length) for length in shape]
    return f"({', '.join(lengths)}{',' * (len(lengths) == 1)})"
