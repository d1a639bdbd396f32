"""The views of a target of points."""

from collections.abc import Sequence

import numpy as np

from calib.corners.view import View
from calib.corners.weights import weigh_views
from calib.session.point_target import PointView


def views_of_points(points: Sequence[PointView]) -> tuple[View, ...]:
    """Return the views as those of a target that has the points of all, one after the other
    (`PointTarget`): each sees its own.
    """
    ends = np.cumsum([len(view.pixels) for view in points])
    views = []
    for view, end in zip(points, ends.tolist(), strict=True):
        rows = slice(end - len(view.pixels), end)
        corners = np.full((ends[-1], 2), np.nan)
        weight = np.zeros(ends[-1])
        covariance = np.full((ends[-1], 2, 2), np.nan)
        corners[rows] = view.pixels
        weight[rows] = 1.0
        covariance[rows] = view.covariance
        views.append(View(view.name, corners, weight, covariance=covariance))
    return weigh_views(views)
