"""Decide which views have enough corners for a pose."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import RejectedPicture, View
from calib.session.board import Board

MIN_POSE_CORNERS = 8
"""A pose has six parameters; eight corners give sixteen coordinates."""
MIN_SPREAD = 0.5
"""Squares: the root mean square distance of the visible corners from their own longest line."""

MIN_SPREAD_PX = 1.0
"""The same spread in the picture, px: a smaller one is a board seen edge-on, or no board."""


def split_usable_views(
    views: Sequence[View], board: Board
) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    """Return the views whose corners are enough for a pose, and the others with the reason."""
    reasons = [
        find_pose_problem(view.seen, board) or _find_line_problem(view, board) for view in views
    ]
    rejected = tuple(
        RejectedPicture(view.name, reason)
        for view, reason in zip(views, reasons, strict=True)
        if reason
    )
    return tuple(view for view, reason in zip(views, reasons, strict=True) if not reason), rejected


def find_pose_problem(visible: NDArray[np.bool_], board: Board) -> str:
    """Return why a view of the (count,) visible corners gives no pose; "" if it does."""
    count = int(np.count_nonzero(visible))
    if count < MIN_POSE_CORNERS:
        return f"only {count} {board.marks} are seen, and a pose needs {MIN_POSE_CORNERS}"
    spread = _transverse_spread(board.points()[visible] / board.square)
    return (
        f"the {board.marks} that are seen lie on one line, which gives no pose"
        if spread < MIN_SPREAD
        else ""
    )


def _find_line_problem(view: View, board: Board) -> str:
    """Return why the corners' pixels give no pose; "" if they do."""
    pixels = view.corners[view.seen]
    if _transverse_spread(pixels) >= MIN_SPREAD_PX:
        return ""
    if not board.has_grid and np.abs(pixels).max() <= 1:
        return "its pixels are fractions of the picture: give them in px"
    return f"its {board.marks} lie on one line or point of the picture, which gives no pose"


def _transverse_spread(points: NDArray[np.float64]) -> float:
    """Return the root mean square distance of (n, 2) points from their own longest line."""
    return float(np.linalg.svd(points - points.mean(0), compute_uv=False)[1] / len(points) ** 0.5)
