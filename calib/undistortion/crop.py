"""Which part of the scene an undistorted picture shows: only what is valid, all that the camera
sees, or something between.
"""

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError
from calib.undistortion.grids import Array
from calib.undistortion.ray_field import RayField
from calib.undistortion.window import Window

LATTICE = 129
"""Pixels along each side of the image at which its edges are looked for."""


def cropped(
    field: RayField, depths: Sequence[float], alpha: float, size: tuple[int, int]
) -> Window:
    """The window of cv2.getOptimalNewCameraMatrix, through the cover.

    Args:
        depths: m; all of them are respected.
        alpha: 0 for a rectangle in which every pixel is valid, 1 for one that holds all pixels of
            the camera; between, a mixture.
        size: px, width and height of the picture.
    """
    if not 0 <= alpha <= 1:
        raise InputError(
            f"crop {alpha:g} is not from 0 to 1: write 0 for valid pixels only, 1 for everything"
            " that the camera sees."
        )
    inner, outer = (
        np.array([-np.inf, -np.inf, np.inf, np.inf]),
        np.array([np.inf, np.inf, -np.inf, -np.inf]),
    )
    for depth in depths:
        for box, (shrink, grow) in (
            (inner, (np.maximum, np.minimum)),
            (outer, (np.minimum, np.maximum)),
        ):
            edges = _edges(field, depth, 0 if box is inner else 1)
            box[:2], box[2:] = shrink(box[:2], edges[:2]), grow(box[2:], edges[2:])
    if (inner[:2] >= inner[2:]).any():
        if alpha < 1:
            raise InputError(
                "no rectangle of the picture is valid throughout: crop with 1, or give the camera"
                " matrix of the picture."
            )
        inner = outer
    zooms = 1 / ((1 - alpha) * _scale(inner, size) + alpha * _scale(outer, size))
    starts = (1 - alpha) * _scale(inner, size) * inner[:2] + alpha * _scale(outer, size) * outer[:2]
    corner = starts * zooms
    return Window(*size, (float(corner[0]), float(corner[1])), (float(zooms[0]), float(zooms[1])))


def _scale(box: Array, size: tuple[int, int]) -> Array:
    """px of the picture for one of the bare pinhole camera, across and down."""
    return np.asarray((np.array(size) - 1) / (box[2:] - box[:2]))


def _edges(field: RayField, depth: float, outer: int) -> Array:
    """(4,) undistorted px left, top, right, bottom: the innermost of what lies on each edge of the
    valid image, or the outermost.
    """
    pixels = np.stack(
        np.meshgrid(
            np.linspace(0, field.width - 1, LATTICE), np.linspace(0, field.height - 1, LATTICE)
        ),
        -1,
    )
    at = field.undistorted(pixels.reshape(-1, 2), depth).reshape(pixels.shape)
    x, y = np.moveaxis(
        np.where(field.sees(pixels[..., 0], pixels[..., 1], depth)[..., None], at, np.nan), -1, 0
    )
    if np.isnan(x).all():
        raise InputError(f"the camera sees nothing at {depth:g} m: write a depth beyond the cover.")
    if outer:
        return np.array([np.nanmin(x), np.nanmin(y), np.nanmax(x), np.nanmax(y)])
    x, y = x[~np.isnan(x).all(1)], y[:, ~np.isnan(y).all(0)]
    return np.array(
        [np.nanmin(x, 1).max(), np.nanmin(y, 0).max(), np.nanmax(x, 1).min(), np.nanmax(y, 0).min()]
    )
