"""cv2.remap without its size limit: OpenCV takes no picture or map with a side of 32,767 pixels or
more.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

MAX_SIDE = 32_766
"""The longest side, in pixels, that OpenCV takes."""
TILE = 4096
"""The side of a tile of a larger picture, in pixels: so small that the source region of a tile is
hardly ever too large.
"""
MARGIN = 8
"""Pixels of the source around the region of a tile: Lanczos' interpolation takes four."""


def remap(
    source: NDArray,
    x: NDArray[np.float32],
    y: NDArray[np.float32],
    interpolation: int,
    border: int,
    into: NDArray | None = None,
) -> NDArray:
    """Return what cv2.remap returns for float maps; beyond its limit, tile by tile.

    Args:
        source: (H, W) or (H, W, C).
        x: (h, w) px of the source.
        y: (h, w) px of the source.
        into: (h, w) or (h, w, C), the array that receives the result.
    """
    if max(*x.shape, *source.shape[:2]) <= MAX_SIDE:
        return cv2.remap(source, x, y, interpolation, into, border)
    if into is None:
        into = np.empty((*x.shape, *source.shape[2:]), source.dtype)
    for top in range(0, x.shape[0], TILE):
        for x_min in range(0, x.shape[1], TILE):
            tile = slice(top, top + TILE), slice(x_min, x_min + TILE)
            _remap_tile(source, x[tile], y[tile], interpolation, border, into[tile])
    return into


def _remap_tile(
    source: NDArray,
    x: NDArray[np.float32],
    y: NDArray[np.float32],
    interpolation: int,
    border: int,
    into: NDArray,
) -> None:
    """Remap from the region of the source that the tile needs; halve the tile while this region is
    too large.
    """
    height, width = source.shape[:2]
    x = np.clip(x, -MARGIN, width - 1 + MARGIN)  # borders reach this far
    y = np.clip(y, -MARGIN, height - 1 + MARGIN)
    x_min, x_end = _source_range(x, width)
    y_min, y_end = _source_range(y, height)
    if max(x_end - x_min, y_end - y_min) > MAX_SIDE and x.size > 1:
        axis = int(np.argmax(x.shape))
        for a, b, out in zip(
            np.array_split(x, 2, axis),
            np.array_split(y, 2, axis),
            np.array_split(into, 2, axis),
            strict=True,
        ):
            _remap_tile(source, a, b, interpolation, border, out)
        return
    region = source[y_min:y_end, x_min:x_end]
    into[...] = cv2.remap(
        region, x - np.float32(x_min), y - np.float32(y_min), interpolation, None, border
    ).reshape(into.shape)


def _source_range(coordinates: NDArray[np.float32], size: int) -> tuple[int, int]:
    """Return the first source pixel that the coordinates need and the one behind the last, with
    MARGIN on both sides; at least one pixel.
    """
    finite = coordinates[np.isfinite(coordinates)]
    if not finite.size:
        return 0, 1
    start = max(0, min(size - 1, int(finite.min()) - MARGIN))
    end = min(size, max(1, int(finite.max()) + 2 + MARGIN))
    return start, end
