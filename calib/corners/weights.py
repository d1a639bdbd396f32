"""The covariances of a session's corners -> how much each weighs in a fit.

A corner's pixels are not all that moves it: the board is not as it is declared, the glass has
relief. So the better half of the corners of a session weigh alike, and the others by how much wider
than the median they spread.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View


def weighted(views: Sequence[View]) -> tuple[View, ...]:
    """The same, each corner's weight the median standard deviation of all over its own, at most 1.

    Views without covariances stay.
    """
    spreads = [
        np.full(len(view.weight), np.nan) if view.covariance is None else _spread(view.covariance)
        for view in views
    ]
    known = np.concatenate([*spreads, np.empty(0)])
    known = known[np.isfinite(known)]
    if not known.size:
        return tuple(views)
    median = float(np.median(known))
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


def _spread(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) px per axis, of (N, 2, 2)."""
    return np.asarray(np.sqrt(np.trace(covariances, axis1=1, axis2=2) / 2))
