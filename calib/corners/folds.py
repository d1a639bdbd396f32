"""The folds of a cross-validation over the poses of a board."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """The views of some poses, which are held out, and the other views."""

    held_out: NDArray[np.bool_]
    """(V,)"""
    test: tuple[View, ...]
    training: tuple[View, ...]


def split_folds(views: Sequence[View], count: int) -> Iterator[Fold]:
    """Yield the folds of some views: each holds out every count-th pose of the board. All views of
    a pose are in one fold, so a burst is not split.
    """
    labels = pose_labels(views)
    for index in range(count):
        held_out = labels % count == index
        yield Fold(
            held_out,
            tuple(view for view, out in zip(views, held_out, strict=True) if out),
            tuple(view for view, out in zip(views, held_out, strict=True) if not out),
        )
