"""One picture's corners, wherever they came from: detection or a corners file; or why there are
none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The corners of one board, in one picture: row by row, columns fastest, as in
    `Board.points`.
    """

    name: str
    """The picture's file name."""
    corners: NDArray[np.float64]
    """(corners of the board, 2) px, NaN where not seen."""
    weight: NDArray[np.float64]
    """(corners of the board,) 1 for the best, smaller for a vaguer corner, 0 where not seen."""
    time_s: float | None = None
    """When it was taken, s from any origin that the session's views share. None: not recorded."""
    pose_id: str | None = None
    """The label of the board's pose that it shows: pictures of one burst share it.

    None: not recorded, so a pose of its own.
    """
    covariance: NDArray[np.float64] | None = None
    """(corners of the board, 2, 2) px^2, by the picture's own noise; NaN where not seen.

    None: not known.
    """

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(corners of the board,) whether the corner was seen."""
        return self.weight > 0

    @property
    def count(self) -> int:
        """How many corners were seen."""
        return int(np.count_nonzero(self.weight > 0))


@dataclass(frozen=True, slots=True)
class Rejected:
    """A picture that is not used, and why. It is always listed, never dropped in silence."""

    name: str
    reason: str


def board_poses(views: Sequence[View]) -> NDArray[np.int64]:
    """(V,) from 0 on, in the order of the views: equal for views of one burst, which are not
    independent of each other, and for copies of one picture, whose corners are the same to the last
    bit.
    """
    labels = [
        (view.corners.tobytes(), view.weight.tobytes()) if view.pose_id is None else view.pose_id
        for view in views
    ]
    numbered = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    return np.array([numbered[label] for label in labels], dtype=np.int64)


def are_timed(views: Sequence[View]) -> bool:
    """Whether every view says when it was taken, and not all say the same."""
    times = {view.time_s for view in views}
    return None not in times and len(times) > 1


def capture_times(views: Sequence[View]) -> NDArray[np.float64]:
    """(V,) s; the views' order, evenly, where they are not timed."""
    if not are_timed(views):
        return np.arange(len(views), dtype=np.float64)
    return np.array([view.time_s for view in views], dtype=np.float64)
