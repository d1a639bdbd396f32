"""Recognise pictures of a board that did not move. They tell nothing new of the camera: counted as
views of their own, they would make a calibration surer than it is, and held-out views would be
views that were fitted.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import RejectedPicture, View

STILL_PX = 0.5
"""px, root mean square distance of the corners in two pictures of a board that did not move: the
noise of corners makes 0.1 to 0.2, and a hand moves a board by more.
"""
SAME_PICTURE_PX = 0.01
"""px, the largest difference between the corners of one picture, read twice; noise separates those
of two pictures.
"""
SAMPLED = 8
"""Corners by which most pairs of views are told apart."""
MIN_COMMON = 0.5
"""Part of the corners of either view that both must show."""


def split_copies(views: Sequence[View]) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    """Return the views, each picture once, and the copies: their corners are the same to the last
    bit.
    """
    groups: dict[tuple[bytes, bytes], list[View]] = {}
    for view in views:
        groups.setdefault((view.corners.tobytes(), view.weight.tobytes()), []).append(view)
    originals = [_original(group) for group in groups.values()]
    copies = [
        RejectedPicture(view.name, f"a copy of {original.name}, which counts once")
        for group, original in zip(groups.values(), originals, strict=True)
        for view in group
        if view is not original
    ]
    return tuple(originals), tuple(copies)


def _original(group: Sequence[View]) -> View:
    """Return the view whose name the other names extend, as IMG_1 (2).jpg extends IMG_1.jpg; the
    first if there is none.
    """
    for view in group:
        stem = view.name.rpartition(".")[0] or view.name
        if all(copy.name.startswith(stem) for copy in group):
            return view
    return group[0]


def count_fitted(views: Sequence[View], fitted_views: Sequence[View]) -> int:
    """Return how many of these views have the corners of a fitted view."""
    if not fitted_views:
        return 0
    corners = np.stack([view.corners for view in fitted_views])
    return sum(_is_there(corners, view.corners) for view in views)


def join_still_poses(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views with one pose id for those in which the board stands still, the name of the
    first of them unless it has an id.
    """
    if not views:
        return ()
    joined: list[View] = []
    corners = np.full((len(views), *views[0].corners.shape), np.nan)  # of each pose's first view
    first_views: list[int] = []
    for index, view in enumerate(views):
        visible = np.where(view.seen[:, None], view.corners, np.nan)
        same = _find_still(corners[: len(first_views)], visible)
        if same is None:
            corners[len(first_views)] = visible
            first_views.append(index)
            joined.append(view)
            continue
        first = joined[first_views[same]]
        pose_id = first.pose_id if first.pose_id is not None else first.name
        joined[first_views[same]] = replace(first, pose_id=pose_id)
        joined.append(replace(view, pose_id=pose_id))
    return tuple(joined)


MAX_NAMES = 3
"""Pictures that a sentence names."""


def describe_still(views: Sequence[View]) -> tuple[str, ...]:
    """Return a sentence on the views that `join_still_poses` joined, none if there are none."""
    names = {view.name for view in views}
    joined = [view.name for view in views if view.pose_id in names and view.pose_id != view.name]
    if not joined:
        return ()
    several = len(joined) > 1
    return (
        f"In {len(joined)} picture{'s' * several} the board stands still where an earlier one"
        f" shows it ({', '.join(joined[:MAX_NAMES])}{', ...' * (len(joined) > MAX_NAMES)}):"
        f" {'they count' if several else 'it counts'} as one view with that.",
    )


def _is_there(views: NDArray[np.float64], corners: NDArray[np.float64]) -> bool:
    """Return True if one of (P, N, 2) px views is of the picture with the (N, 2) px corners."""
    if views.shape[1:] != corners.shape:
        return False
    distances = np.abs(views - corners).max(-1)  # (P, N), NaN where either is not visible
    largest = np.where(np.isfinite(distances), distances, 0.0).max(1)
    return bool(((largest < SAME_PICTURE_PX) & _has_common(views, corners)).any())


def _find_still(poses: NDArray[np.float64], corners: NDArray[np.float64]) -> int | None:
    """Return the index of the first of (P, N, 2) px views whose corners lie where the (N, 2) px of
    this one lie; None if there is none.
    """
    # The squares of a few corners alone are often too many for the mean square of all.
    sampled = slice(None, None, len(corners) // SAMPLED + 1)
    few_squares = np.nansum((poses[:, sampled] - corners[sampled]) ** 2, (1, 2))
    near = np.flatnonzero(few_squares < STILL_PX**2 * len(corners))
    squares = ((poses[near] - corners) ** 2).sum(-1)  # (P, N), NaN where either is not visible
    common = np.isfinite(squares)
    mean_squares = np.where(common, squares, 0.0).sum(1) / np.maximum(common.sum(1), 1)
    still = (mean_squares < STILL_PX**2) & _has_common(poses[near], corners)
    return int(near[np.argmax(still)]) if still.any() else None


def _has_common(views: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (P,) whether (P, N, 2) px views show enough of the corners that (N, 2) px show."""
    visible = np.isfinite(views[..., 0])
    shown = np.isfinite(corners[:, 0])
    needed = MIN_COMMON * np.maximum(visible.sum(1), shown.sum())
    return np.asarray((visible & shown).sum(1) >= np.maximum(needed, 1))
