"""cv2.remap without its limit: it takes no picture or map of 32,767 pixels or more across or
down.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

MOST = 32_766
"""Pixels across or down that OpenCV takes at once."""
TILE = 4096
"""Pixels across and down of a part of a larger picture: few enough that the part of the source it
is seen in is hardly ever too large.
"""
REACH = 8
"""Pixels of the source around those that a part is seen at: Lanczos' interpolation takes four."""


def remap(
    source: NDArray,
    x: NDArray[np.float32],
    y: NDArray[np.float32],
    interpolation: int,
    border: int,
    into: NDArray | None = None,
) -> NDArray:
    """As cv2.remap of float maps; beyond its limit, part by part.

    Args:
        source: (H, W) or (H, W, C).
        x: (h, w) px of the source.
        y: (h, w) likewise.
        into: (h, w) or (h, w, C), where to write the result.
    """
    if max(*x.shape, *source.shape[:2]) <= MOST:
        return cv2.remap(source, x, y, interpolation, into, border)
    if into is None:
        into = np.empty((*x.shape, *source.shape[2:]), source.dtype)
    for top in range(0, x.shape[0], TILE):
        for left in range(0, x.shape[1], TILE):
            part = slice(top, top + TILE), slice(left, left + TILE)
            _remap_part(source, x[part], y[part], interpolation, border, into[part])
    return into


def _remap_part(
    source: NDArray,
    x: NDArray[np.float32],
    y: NDArray[np.float32],
    interpolation: int,
    border: int,
    into: NDArray,
) -> None:
    """From the part of the source that is seen, by halves where that is too large still."""
    x, y = (
        np.clip(at, -REACH, size - 1 + REACH)
        for at, size in zip((x, y), source.shape[1::-1], strict=True)
    )  # as far as borders go
    (left, right), (top, bottom) = (
        _reach(at, size) for at, size in zip((x, y), source.shape[1::-1], strict=True)
    )
    if max(right - left, bottom - top) > MOST and x.size > 1:
        axis = int(np.argmax(x.shape))
        for a, b, out in zip(
            np.array_split(x, 2, axis),
            np.array_split(y, 2, axis),
            np.array_split(into, 2, axis),
            strict=True,
        ):
            _remap_part(source, a, b, interpolation, border, out)
        return
    near = source[top:bottom, left:right]
    into[...] = cv2.remap(
        near, x - np.float32(left), y - np.float32(top), interpolation, None, border
    ).reshape(into.shape)


def _reach(at: NDArray[np.float32], size: int) -> tuple[int, int]:
    """The first pixel that some coordinates are seen at, and the one after the last, with REACH on
    both sides; at least one pixel.
    """
    known = at[np.isfinite(at)]
    if not known.size:
        return 0, 1
    return max(0, min(size - 1, int(known.min()) - REACH)), min(
        size, max(1, int(known.max()) + 2 + REACH)
    )
