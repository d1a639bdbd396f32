"""Average neighbouring points of a dense view, so that a fit costs what the points tell.

A fit cannot use more points than the finest thing that it estimates has numbers. Points in one
square of the picture become one: a quadratic is fitted to their places on the target, and its value
at the mean pixel is free of the curvature that a plain mean would keep. Neighbours in the picture
may be far from each other on a target that is not flat, so some of its points are used instead.
"""

import numpy as np
from numpy.typing import NDArray

from calib.session.point_target import PointView

Floats = NDArray[np.float64]

MAX_POINTS = 600
"""Points of a view after averaging: about 30 by 20 squares over the picture, finer than the relief
of a cover that a fit estimates by default.
"""
MIN_MEMBERS = 12
"""Points in a square, for a quadratic with six numbers along each axis."""
MIN_SIGMA = 0.002
"""px: no averaged point is known better. A simulated screen whose pixels are half of the camera's
leaves 0.0016 px without noise.
"""
MAX_SPREAD = 3.0
"""The standard deviation of an averaged point over the median of its view, above which it is left
out: its square is at an edge, and it tells less than a ninth.
"""
MAX_CONDITION = 1e10
"""The condition number of a square's normal equations, above which its points are on a line."""


def bin_points(view: PointView) -> PointView:
    """Return the view with at most MAX_POINTS points."""
    if len(view.pixels) <= MAX_POINTS:
        return view
    if view.places.shape[1] == 3:
        order = np.random.default_rng(0).permutation(len(view.pixels))  # every n-th may be a line
        rows = np.sort(order[:MAX_POINTS])
        return PointView(view.name, view.pixels[rows], view.places[rows], view.covariance[rows])
    wanted = min(MAX_POINTS, len(view.pixels) // MIN_MEMBERS)
    cell, side = _cells(view.pixels, wanted)
    count = int(cell.max()) + 1
    variance = np.trace(view.covariance, axis1=1, axis2=2) / 2
    weight = 1 / variance

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(cell, values, count), np.float64)

    members = np.bincount(cell, minlength=count)
    weights = total(weight)
    middle = np.stack([total(weight * u) / weights for u in view.pixels.T], -1)
    u, v = ((view.pixels - middle[cell]) / side).T
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], -1)
    normal = np.empty((count, 6, 6))
    for i in range(6):
        for k in range(i, 6):
            normal[:, i, k] = normal[:, k, i] = total(weight * terms[:, i] * terms[:, k])
    usable = members >= MIN_MEMBERS
    usable[usable] = np.linalg.cond(normal[usable]) < MAX_CONDITION
    normal[~usable] = np.eye(6)
    inverse = np.linalg.inv(normal)
    moments = np.empty((count, 6, 2))
    origin = np.stack([total(weight * x) / weights for x in view.places.T], -1)
    offset = view.places - origin[cell]
    for i in range(6):
        for k in range(2):
            moments[:, i, k] = total(weight * terms[:, i] * offset[:, k])
    solution = inverse @ moments
    slopes = solution[:, 1:3].swapaxes(1, 2) / side
    usable &= np.linalg.det(slopes) != 0
    slopes[~usable] = np.eye(2)
    residual = offset - np.einsum("nt,nti->ni", terms, solution[cell])
    pixels = np.einsum("nij,nj->ni", np.linalg.inv(slopes)[cell], residual)
    freedom = np.maximum(2 * members - 12, 1)
    misfit = total(weight * (pixels**2).sum(-1)) / freedom
    shape = np.empty((count, 2, 2))
    for i in range(2):
        for k in range(2):
            shape[:, i, k] = total(weight * view.covariance[:, i, k]) / members
    covariance = shape * (inverse[:, 0, 0] * np.maximum(misfit, 1))[:, None, None]
    spread = np.trace(covariance, axis1=1, axis2=2)
    usable &= spread <= MAX_SPREAD**2 * np.median(spread[usable])
    return PointView(
        view.name,
        middle[usable],
        (origin + solution[:, 0])[usable],
        covariance[usable] + MIN_SIGMA**2 * np.eye(2),
    )


def _cells(pixels: Floats, wanted: int) -> tuple[NDArray[np.int64], float]:
    """Return the (N,) number of each pixel's square, and the side in px of squares of which at most
    `wanted` have a pixel.
    """
    low = pixels.min(0)
    extent = np.maximum(np.ptp(pixels, axis=0), 1.0)
    side = float(np.sqrt(extent.prod() / wanted)) / 2
    while True:
        columns, rows = np.floor((pixels - low) / side).astype(np.int64).T
        _, cell = np.unique(columns + (columns.max() + 1) * rows, return_inverse=True)
        if cell.max() < wanted:
            return cell, side
        side *= 1.03
