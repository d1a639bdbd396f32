"""The error of a fit of the intrinsics on held-out views, by which lens models are compared."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.corners.folds import split_folds
from calib.corners.view import View, pose_labels
from calib.session.board import Board

FOLDS = 4
MAX_MEDIANS = 4.0
"""Limit of a view's error, in medians: otherwise a few bad views would dominate the mean."""

MIN_LENS_IMPROVEMENT = 0.02
"""Fraction by which a lens with more freedom must lower the held-out error."""

Array = NDArray[np.float64]


class LensModelFit(Protocol):
    """A lens that is fitted to views."""

    def errors(self, views: Sequence[View], board: Board) -> Array:
        """Return the (V,) root mean square errors, px, of views that it was not fitted to, with
        their poses refitted; NaN for a view without a pose.
        """
        ...


def fold_count(views: Sequence[View]) -> int:
    return min(FOLDS, int(pose_labels(views).max() + 1) // 2)


def held_out_errors(
    views: Sequence[View], board: Board, fit: Callable[[Sequence[View], int], LensModelFit]
) -> Array:
    """Return the (V,) errors, px, of each view by the fit to the views outside its fold.

    `fit` gets the fitted views and the number of the fold.
    """
    per_view = np.empty(len(views))
    for index, fold in enumerate(split_folds(views, fold_count(views))):
        per_view[fold.held_out] = fit(fold.training, index).errors(fold.test, board)
    return per_view


def clipped_mean(per_view: Array) -> float:
    """Return the mean error of all views, px, each limited to MAX_MEDIANS medians."""
    per_view = np.nan_to_num(per_view, nan=np.inf)
    return float(np.minimum(per_view, MAX_MEDIANS * np.median(per_view)).mean())
