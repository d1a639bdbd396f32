"""The message about pictures that show another board than the declared one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.corners.board_size import ShownSize, shown_size
from calib.corners.other_coding import other_coding
from calib.corners.unusable_target import why_unusable
from calib.io.numerals import counted
from calib.session.board import Board

SAMPLE_SIZE = 6
"""Pictures that are searched for another board, if none shows the declared one."""


def describe_other_board(pictures: Sequence[NDArray[np.uint8]], board: Board) -> str:
    """Return the sentence about the board that pictures show in place of the declared one; empty
    if they do not agree on one.

    Args:
        pictures: (H, W) uint8, none of which shows the declared board.
        board: the declared board.
    """
    if board.coding:
        return other_coding(pictures, board)
    shown = shown_size(pictures)
    if shown and {shown.columns, shown.rows} == {board.columns, board.rows}:
        return ""
    if reason := why_unusable(pictures, shown):
        return f"{reason}."
    if not shown:
        return ""
    return _describe_size(shown, board, f"none of these shows the declared {board}")


def describe_larger_board(pictures: Sequence[NDArray[np.uint8]], board: Board) -> str:
    """Return the sentence about a larger checkerboard than the declared one, which then is another
    part of it in each picture; empty if the pictures do not agree on one.

    Args:
        pictures: (H, W) uint8.
        board: the declared board.
    """
    if board.coding:
        return ""
    shown = shown_size(pictures[:SAMPLE_SIZE])
    if not shown or {shown.columns, shown.rows} == {board.columns, board.rows}:
        return ""
    longer, shorter = max(board.columns, board.rows), min(board.columns, board.rows)
    if longer > shown.columns or shorter > shown.rows:
        return ""
    return _describe_size(
        shown, board, f"the declared {board} is a part of it, another one in each picture"
    )


def _describe_size(shown: ShownSize, board: Board, difference: str) -> str:
    sizes = {
        "board.columns": (board.columns, shown.columns),
        "board.rows": (board.rows, shown.rows),
    }
    keys = [f"{key}: {size}" for key, (declared, size) in sizes.items() if size != declared]
    verb = "show" if len(shown.pictures) > 1 else "shows"
    return (
        f"{counted(len(shown.pictures), 'picture')} {verb} a board of"
        f" {shown.columns}x{shown.rows} inner corners, and {difference}: write"
        f" {', '.join(keys)} in session.yaml, or call calib fit with"
        f" --board {shown.columns}x{shown.rows}."
    )
