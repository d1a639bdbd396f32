"""The error on views that a fit of the intrinsics has not seen: it compares lens models."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels
from calib.session.board import Board

FOLDS = 4
MOST = 4.0
"""Times the median: no view counts for more, or a few bad ones would drown the rest."""

Array = NDArray[np.float64]


class Fitted(Protocol):
    """A lens that was fitted to views."""

    def errors(self, views: Sequence[View], board: Board) -> Array:
        """(V,) px, the root mean square of views that it was not fitted to, their poses fitted; NaN
        for one that has none.
        """
        ...


def folds_of(views: Sequence[View]) -> int:
    return min(FOLDS, int(pose_labels(views).max() + 1) // 2)


def held_out_errors(
    views: Sequence[View], board: Board, fit: Callable[[Sequence[View], int], Fitted]
) -> Array:
    """(V,) px, each view's error by the fit to those outside its fold, whose number `fit` is told;
    views of one pose stay together.
    """
    poses, folds = pose_labels(views), folds_of(views)
    per_view = np.empty(len(views))
    for fold in range(folds):
        out = poses % folds == fold
        rest, unseen = (
            [view for view, held in zip(views, out, strict=True) if held == which]
            for which in (False, True)
        )
        per_view[out] = fit(rest, fold).errors(unseen, board)
    return per_view


def summed(per_view: Array) -> float:
    """px, of all views together."""
    per_view = np.nan_to_num(per_view, nan=np.inf)
    return float(np.minimum(per_view, MOST * np.median(per_view)).mean())
