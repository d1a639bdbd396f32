"""The window of an undistorted picture: only valid pixels, everything that the camera sees, or a
mixture of the two.
"""

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError
from calib.undistortion.grids import Array
from calib.undistortion.ray_field import RayField
from calib.undistortion.window import Window

LATTICE = 129
"""The number of pixels along each side of the image that sample its edges."""

MIN_BORDER_PX = 0.5
"""px: a narrower border blackens no pixel."""


def crop_window(
    field: RayField, depths: Sequence[float], alpha: float, size: tuple[int, int]
) -> Window:
    """Return the window of cv2.getOptimalNewCameraMatrix for a camera behind its cover.

    Args:
        depths: m; the window holds for all of them.
        alpha: 0 for a rectangle in which every pixel is valid, 1 for one that holds all pixels of
            the camera, between 0 and 1 for a mixture.
        size: px, width and height of the picture.
    """
    if not 0 <= alpha <= 1:
        raise InputError(
            f"crop {alpha:g} is not from 0 to 1: write 0 for valid pixels only, 1 for everything"
            " that the camera sees."
        )
    inner = np.array([-np.inf, -np.inf, np.inf, np.inf])
    outer = np.array([np.inf, np.inf, -np.inf, -np.inf])
    for depth in depths:
        edges = _edges(field, depth, 0)
        inner[:2] = np.maximum(inner[:2], edges[:2])
        inner[2:] = np.minimum(inner[2:], edges[2:])
        edges = _edges(field, depth, 1)
        outer[:2] = np.minimum(outer[:2], edges[:2])
        outer[2:] = np.maximum(outer[2:], edges[2:])
    if (inner[:2] >= inner[2:]).any():
        if alpha < 1:
            raise InputError(
                "no rectangle of the picture has valid pixels only: crop with 1, or give the camera"
                " matrix of the picture."
            )
        inner = outer
    zooms = 1 / ((1 - alpha) * _scale(inner, size) + alpha * _scale(outer, size))
    starts = (1 - alpha) * _scale(inner, size) * inner[:2] + alpha * _scale(outer, size) * outer[:2]
    corner = starts * zooms
    return Window(*size, (float(corner[0]), float(corner[1])), (float(zooms[0]), float(zooms[1])))


def has_black_border(field: RayField, depth: float) -> bool:
    """Return True if a part of the picture at the camera's own focal length is black, and a crop of
    0 leaves that part out.

    Args:
        field: the camera's rays.
        depth: m
    """
    try:
        inner = _edges(field, depth, 0)
    except InputError:  # nothing is seen at this depth
        return False
    has_rectangle = bool((inner[:2] < inner[2:]).all())
    last = np.array([field.width - 1, field.height - 1])
    is_inside = (inner[:2] > MIN_BORDER_PX).any() or (inner[2:] < last - MIN_BORDER_PX).any()
    return has_rectangle and bool(is_inside)


def _scale(box: Array, size: tuple[int, int]) -> Array:
    """Return px of the picture per px of the bare pinhole camera, along x and y."""
    return np.asarray((np.array(size) - 1) / (box[2:] - box[:2]))


def _edges(field: RayField, depth: float, outer: int) -> Array:
    """Return (4,) undistorted px left, top, right, bottom: the innermost points of the four edges
    of the valid image, or with `outer` the outermost.
    """
    pixels = np.stack(
        np.meshgrid(
            np.linspace(0, field.width - 1, LATTICE), np.linspace(0, field.height - 1, LATTICE)
        ),
        -1,
    )
    undistorted = field.undistort_pixels(pixels.reshape(-1, 2), depth).reshape(pixels.shape)
    visible = field.sees(pixels[..., 0], pixels[..., 1], depth)
    x = np.where(visible, undistorted[..., 0], np.nan)
    y = np.where(visible, undistorted[..., 1], np.nan)
    if np.isnan(x).all():
        raise InputError(f"the camera sees nothing at {depth:g} m: write a depth beyond the cover.")
    if outer:
        return np.array([np.nanmin(x), np.nanmin(y), np.nanmax(x), np.nanmax(y)])
    x, y = x[~np.isnan(x).all(1)], y[:, ~np.isnan(y).all(0)]
    return np.array(
        [np.nanmin(x, 1).max(), np.nanmin(y, 0).max(), np.nanmax(x, 1).min(), np.nanmax(y, 0).min()]
    )
