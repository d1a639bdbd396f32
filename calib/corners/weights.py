"""Derive the weight of each corner in a fit from the covariances of a session's corners.

The pixels' noise is not the only error of a corner: the board differs from its declaration, and the
glass has relief. So the better half of a session's corners have equal weights, and the others are
weighted by the ratio of the median standard deviation to their own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View


def weigh_views(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views with each corner's weight set to the median standard deviation of all
    corners over its own, at most 1.

    Views without covariances keep their weights.
    """
    spreads = [
        np.full(len(view.weight), np.nan)
        if view.covariance is None
        else _mean_sigma(view.covariance)
        for view in views
    ]
    finite_spreads = np.concatenate([*spreads, np.empty(0)])
    finite_spreads = finite_spreads[np.isfinite(finite_spreads)]
    if not finite_spreads.size:
        return tuple(views)
    median = float(np.median(finite_spreads))
    return tuple(
        (
            view
            if view.covariance is None
            else replace(
                view,
                weight=np.where(view.seen, np.minimum(1, median / np.maximum(spread, 1e-9)), 0.0),
            )
        )
        for view, spread in zip(views, spreads, strict=True)
    )


def _mean_sigma(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N,) standard deviations per axis, px, of (N, 2, 2) px^2 covariances."""
    return np.asarray(np.sqrt(np.trace(covariances, axis1=1, axis2=2) / 2))
