"""Functions on evenly spaced nodes over a picture and the cells between them."""

import numpy as np
from numpy.typing import NDArray

from calib.undistortion.spline import MIN_NODES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def grid_nodes(size: int, spacing: float, margin: float) -> Array:
    """Return evenly spaced nodes from -0.5 - margin to size - 0.5 + margin, about `spacing` apart,
    at least six.
    """
    count = max(MIN_NODES, int(np.ceil((size + 2 * margin) / spacing)) + 1)
    return np.linspace(-0.5 - margin, size - 0.5 + margin, count)


def midpoints(nodes: Array) -> Array:
    """Return the (n - 1,) midpoints between neighbours of (n,) nodes."""
    return np.asarray((nodes[1:] + nodes[:-1]) / 2)


def cell_index(coordinates: NDArray[np.generic], nodes: Array) -> NDArray[np.intp]:
    """Return the index of the last of the evenly spaced nodes below each coordinate, from 0 to the
    last but one.
    """
    steps = (coordinates - nodes[0]) / (nodes[1] - nodes[0])
    return np.asarray(np.clip(steps, 0, len(nodes) - 2).astype(np.intp))


def all_corners_true(nodes: Mask) -> Mask:
    """Return (h - 1, w - 1), true for cells whose four nodes are all true."""
    return nodes[1:, 1:] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[:-1, :-1]


def interior_cells(solved: Mask) -> Mask:
    """Return (h, w), true for cells that are more than two cells away from every unsolved cell:
    finer nodes would not help the others.
    """
    if solved.all():
        return solved
    from scipy.ndimage import distance_transform_edt  # most covers do not need it

    return np.asarray(distance_transform_edt(solved) > 2)


def extrapolate(field: Array, valid: Mask) -> Array:
    """Return the (h, w, ...) field with the value of the nearest valid node at every node that is
    not valid.
    """
    if valid.all():
        return field
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(field[tuple(nearest)])
