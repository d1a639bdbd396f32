"""The difference between a session's board and that of a calibration."""

import math

from calib.session.board import Board

SAME_SIDE = 1e-3
"""The relative difference below which two sides are the same, written or measured again."""


def has_same_corners(board: Board, fitted: Board) -> bool:
    """Return True if both boards have corners in as many columns and rows."""
    return (board.columns, board.rows) == (fitted.columns, fitted.rows)


def describe_difference(board: Board, fitted: Board, place: str) -> str:
    """Return a clause on a board that has other columns, rows or squares than the calibration's;
    empty for the same board and for targets of points, unless the calibration's alone is flat: it
    may be bent, which means nothing for other points.

    Args:
        place: the words for where the board is, such as "in these pictures".
    """
    if fitted.is_flat and not board.is_flat:
        return f"the target is flat in the calibration, and not {place}"
    if not (board.has_grid and fitted.has_grid):
        return ""
    if not has_same_corners(board, fitted):
        return (
            f"the board is {board} with {board.cell}s of {1e3 * board.square:g} mm {place}, and"
            f" {fitted} with {fitted.cell}s of {1e3 * fitted.square:g} mm in the calibration"
        )
    if not math.isclose(board.square, fitted.square, rel_tol=SAME_SIDE):
        return (
            f"the {board.cell}s are {1e3 * board.square:g} mm {place}, and"
            f" {1e3 * fitted.square:g} mm in the calibration"
        )
    return ""
