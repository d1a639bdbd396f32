"""One picture -> the corners of its board, of whatever kind."""

from numpy.typing import NDArray

from calib.corners import detect
from calib.corners.coded import find_coded
from calib.corners.detection import Detection, NotFound
from calib.corners.part import find_part
from calib.session.board import Board

ADVICE = "show the whole board with its white margin, sharp and evenly lit"


def find_board(grey: NDArray, board: Board) -> Detection | NotFound:
    """In a (H, W) uint8 or uint16 picture."""
    if board.coding:
        return find_coded(detect.eight_bits(grey), grey, board)
    found = detect.find_corners(grey, board)
    if found and found.twice:
        return NotFound(two_boards(board))
    return found or find_part(grey, board) or NotFound(f"no {board} board found: {ADVICE}")


def two_boards(board: Board) -> str:
    """What is wrong with a picture that shows it twice: which of both it was would be anybody's
    guess.
    """
    return f"two {board} boards are seen: show one board alone"
