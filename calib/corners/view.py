"""The corners of one picture, detected or from a corners file, or the reason why it is rejected."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NUMBER = re.compile(r"\d[\d.]*")
"""A number in the reason of a rejected picture."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The corners of one board in one picture: row by row, columns fastest, as in
    `Board.points`.
    """

    name: str
    """The picture's file name."""
    corners: NDArray[np.float64]
    """(corners of the board, 2) px, NaN where not visible."""
    weight: NDArray[np.float64]
    """(corners of the board,) 1 for the best, smaller for a less certain corner, 0 where not
    visible.
    """
    time_s: float | None = None
    """The time of the exposure, s from any origin that the session's views share. None: not
    recorded.
    """
    pose_id: str | None = None
    """The label of the board's pose: pictures of one burst share it.

    None: not recorded, so the view has a pose of its own.
    """
    covariance: NDArray[np.float64] | None = None
    """(corners of the board, 2, 2) px^2 from the picture's own noise; NaN where not visible. None:
    not known.
    """
    blur: NDArray[np.float64] | None = None
    """(corners of the board, 2) px, the blur across the edge that runs along the corner's row, and
    across the one along its column; NaN where not visible. None: not known.

    An edge is fitted as a sharp step under a Gaussian, whose standard deviation this is. Lens,
    motion and the pixel's own square (12^-1/2 px) contribute to it; sharpening makes it smaller.
    """

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(corners of the board,) true where the corner is visible."""
        return self.weight > 0

    @property
    def count(self) -> int:
        """The number of visible corners."""
        return int(np.count_nonzero(self.weight > 0))


MISFIT = "px do not fit the"
"""The words in the reason of a view that is not used because its error is too large."""
BARE_PREFIX = "bare/"
"""The start of the names of rejected pictures that were taken without the cover."""


@dataclass(frozen=True, slots=True)
class RejectedPicture:
    """A picture that is not used, and the reason. It is always listed, never dropped silently."""

    name: str
    reason: str

    @property
    def is_misfit(self) -> bool:
        """True if it is a view of the session whose error is too large, not one of bare/."""
        return MISFIT in self.reason and not self.name.startswith(BARE_PREFIX)


def describe_most(rejected: Sequence[RejectedPicture]) -> str:
    """Return the most frequent reason of rejected pictures in brackets, behind their count; empty
    without any. Reasons that differ by their numbers alone are the same.
    """
    if not rejected:
        return ""
    kinds = [NUMBER.sub("", picture.reason) for picture in rejected]
    kind, count = Counter(kinds).most_common(1)[0]
    first = rejected[kinds.index(kind)]
    if count == 1:
        others = f", and {len(rejected) - 1} for other reasons" if len(rejected) > 1 else ""
        return f" ({first.name} is left out: {first.reason}{others})"
    return f" ({count} of {len(rejected)} left out: {first.reason})"


def pose_labels(views: Sequence[View]) -> NDArray[np.int64]:
    """Return (V,) pose labels from 0 on, in the order of the views. Views of one burst share a
    label, because they are not independent of each other. So do copies of one picture, whose
    corners are the same to the last bit.
    """
    names = [
        (view.corners.tobytes(), view.weight.tobytes()) if view.pose_id is None else view.pose_id
        for view in views
    ]
    labels = {name: label for label, name in enumerate(dict.fromkeys(names))}
    return np.array([labels[name] for name in names], dtype=np.int64)


def are_timed(views: Sequence[View]) -> bool:
    """True if every view has a time, and the times are not all equal."""
    times = {view.time_s for view in views}
    return None not in times and len(times) > 1


def capture_times(views: Sequence[View]) -> NDArray[np.float64]:
    """Return (V,) s; evenly spaced in the views' order where they are not timed."""
    if not are_timed(views):
        return np.arange(len(views), dtype=np.float64)
    return np.array([view.time_s for view in views], dtype=np.float64)
