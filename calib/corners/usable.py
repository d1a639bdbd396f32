"""Which views can give a pose."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import Rejected, View
from calib.session.board import Board

FEWEST_CORNERS = 8
"""A pose takes six numbers of the sixteen."""
FLATTEST = 0.5
"""Squares: how far, root mean square, the seen corners must spread across their own longest line.
"""

NARROWEST_PX = 1.0
"""The same in the picture, px: a board that is seen edge-on, or corners that are none."""


def with_poses(
    views: Sequence[View], board: Board
) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    """The views whose corners are enough for a pose, and the others with the reason."""
    reasons = [no_pose(view.seen, board) or _in_a_line(view) for view in views]
    rejected = tuple(
        Rejected(view.name, reason) for view, reason in zip(views, reasons, strict=True) if reason
    )
    return tuple(view for view, reason in zip(views, reasons, strict=True) if not reason), rejected


def no_pose(seen: NDArray[np.bool_], board: Board) -> str:
    """Why a view of these (count,) corners gives no pose; empty if it does."""
    count = int(np.count_nonzero(seen))
    if count < FEWEST_CORNERS:
        return f"only {count} corners are seen, and a pose needs {FEWEST_CORNERS}"
    across = _across(board.points()[seen] / board.square)
    return (
        "the corners that are seen lie on one line, which gives no pose"
        if across < FLATTEST
        else ""
    )


def _in_a_line(view: View) -> str:
    across = _across(view.corners[view.seen])
    return (
        "its corners lie on one line or point of the picture, which gives no pose"
        if across < NARROWEST_PX
        else ""
    )


def _across(points: NDArray[np.float64]) -> float:
    """How far (n, 2) points spread across their own longest line, root mean square."""
    return float(np.linalg.svd(points - points.mean(0), compute_uv=False)[1] / len(points) ** 0.5)
