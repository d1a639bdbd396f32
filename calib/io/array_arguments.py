"""The arguments of the library's calls: whatever array or number a program passes becomes float64
in one piece, or an InputError that says what is expected and what came.

A place that is not finite is no mistake: the library itself answers NaN where a camera sees
nothing, and takes that back.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError, brief
from calib.io.numerals import number

Array = NDArray[np.float64]

FARTHEST_PX = 1e9
"""px: what is farther is on no picture. Its square and its cube are still numbers."""
FARTHEST_M = 1e12
"""m: what is farther is at infinity, to the last digit of a pixel."""
PICTURE_TYPES = tuple(np.dtype(kind) for kind in ("u1", "u2", "i2", "f4", "f8"))
"""The types of pixels that cv2.remap takes."""


def numbers(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """Return the values as float64 in one piece.

    Args:
        values: real numbers of any type; an empty list stands for no rows.
        shape: the expected shape; None for a length that may be any.
        name: of the argument, for the message.
    """
    array = as_array(values, name)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name} is not an array of real numbers: give it as {_shown(shape)}.")
    if array.size == 0 and array.ndim == 1 and shape[0] is None:
        array = array.reshape(0, *(length or 0 for length in shape[1:]))
    if array.ndim != len(shape) or any(
        expected not in (None, length) for expected, length in zip(shape, array.shape, strict=True)
    ):
        raise InputError(
            f"{name} has shape {_shown(array.shape)} where {_shown(shape)} is expected."
        )
    with np.errstate(all="ignore"):  # a long double may be too large
        converted = np.ascontiguousarray(array, dtype=np.float64)
    return converted if converted.flags.writeable else converted.copy()  # torch shares no other


def as_array(values: object, name: str) -> NDArray[Any]:
    """Return whatever NumPy makes of it."""
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError):  # of rows of different lengths, for one
        raise InputError(
            f"{name} is not an array: give rows of numbers, all of one length."
        ) from None


def one_of(value: object, allowed: Sequence[int], name: str) -> int:
    """Return a whole number of those that are allowed."""
    for whole in allowed:
        if number(value, name) == whole:
            return whole
    listed = ", ".join(map(str, allowed))
    raise InputError(f"{name} is {brief(repr(value))}: give one of {listed}.")


def pixel_rows(values: ArrayLike, name: str = "pixels") -> Array:
    """Return (N, 2) px; NaN in a row that is on no picture."""
    pixels = numbers(values, (None, 2), name)
    with np.errstate(invalid="ignore"):
        outside = np.asarray(~(np.abs(pixels) < FARTHEST_PX).all(-1))
    if not outside.any():
        return pixels
    return np.where(outside[:, None], np.nan, pixels)


def point_rows(values: ArrayLike, name: str = "points") -> Array:
    """Return (N, 3) m; a point that is farther away than FARTHEST_M is moved to that distance along
    its direction, and one that is not finite is NaN.
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
    """Return (count,): one for each row, or the same for all."""
    if isinstance(values, int | float | np.generic) or getattr(values, "ndim", 1) == 0:
        return np.full(count, number(values, name))
    return numbers(values, (count,), name)


def indices(values: ArrayLike, count: int, limit: int, name: str) -> NDArray[np.intp]:
    """Return (count,) whole numbers from 0 to limit - 1."""
    found = numbers(values, (count,), name)
    if not ((found >= 0) & (found < limit) & (np.floor(found) == found)).all():
        raise InputError(f"{name} must hold whole numbers, each from 0 on and less than {limit}.")
    return found.astype(np.intp)


def picture(image: ArrayLike, width: int, height: int, name: str = "the picture") -> NDArray:
    """Return (height, width) or (height, width, channels) pixels in one piece and this machine's
    byte order, of a type that OpenCV takes.
    """
    pixels = as_array(image, name)
    native = pixels.dtype.newbyteorder("=")
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and not 1 <= pixels.shape[2] <= 4):
        raise InputError(
            f"{name} has shape {_shown(pixels.shape)}: give (height, width) or (height, width, 3)."
        )
    if native not in PICTURE_TYPES:
        raise InputError(f"{name} has pixels of {pixels.dtype}: give uint8, uint16 or float32.")
    if pixels.shape[:2] != (height, width):
        raise InputError(
            f"{name} is {pixels.shape[1]}x{pixels.shape[0]} px where the calibration is for"
            f" {width}x{height}: give pictures of the calibrated camera mode."
        )
    return np.ascontiguousarray(pixels, dtype=native)


def on_finite_rows(
    function: Callable[[Array], tuple[Array, ...]], rows: Array, *widths: int
) -> tuple[Array, ...]:
    """Return the function of (N, k) rows: (N, width) for each of the widths, and NaN for a row that
    is not finite, which the function never sees.
    """
    finite = np.isfinite(rows).all(-1)
    if finite.all():
        return function(rows)
    answers = tuple(np.full((len(rows), width), np.nan) for width in widths)
    for answer, part in zip(answers, function(rows[finite]), strict=True):
        answer[finite] = part
    return answers


def _shown(shape: tuple[int | None, ...]) -> str:
    """A shape as the documents write it, such as (N, 2)."""
    lengths = ["N" if length is None else str(length) for length in shape]
    return f"({', '.join(lengths)}{',' * (len(lengths) == 1)})"
