"""Evenly spaced nodes over a picture, and the cells between them."""

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.spline import FEWEST

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def grid(size: int, spacing: float, margin: float) -> Array:
    """Evenly spaced nodes from -0.5 - margin to size - 0.5 + margin, about `spacing` apart and six
    at least.
    """
    count = max(FEWEST, int(np.ceil((size + 2 * margin) / spacing)) + 1)
    return np.linspace(-0.5 - margin, size - 0.5 + margin, count)


def middles(nodes: Array) -> Array:
    """(n - 1,) halfway between each two of (n,) nodes."""
    return np.asarray((nodes[1:] + nodes[:-1]) / 2)


def cell(at: NDArray[np.generic], nodes: Array) -> NDArray[np.intp]:
    """Between which two of the evenly spaced nodes each coordinate lies: the index of the first."""
    return np.asarray(
        np.clip((at - nodes[0]) / (nodes[1] - nodes[0]), 0, len(nodes) - 2).astype(np.intp)
    )


def all_corners(nodes: Mask) -> Mask:
    """(h - 1, w - 1) whether all four nodes around a cell are true."""
    return nodes[1:, 1:] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[:-1, :-1]


def inner(sure: Mask) -> Mask:
    """(h, w) which cells are more than two away from every one that is not sure, of (h, w): finer
    nodes would not help the others.
    """
    if sure.all():
        return sure
    from scipy.ndimage import distance_transform_edt  # which most covers do without

    return np.asarray(distance_transform_edt(sure) > 2)


def extrapolated(field: Array, valid: Mask) -> Array:
    """The (h, w, ...) field, with the value of the nearest valid node where it is not valid
    itself.
    """
    if valid.all():
        return field
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(field[tuple(nearest)])
