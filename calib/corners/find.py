"""Find the corners of a board of any kind in one picture."""

from numpy.typing import NDArray

from calib.corners import detect
from calib.corners.coded import find_coded_board
from calib.corners.detection import Detection, NotFound
from calib.corners.partial_board import find_partial_board
from calib.session.board import Board

CHECKERBOARD_ADVICE = "show the whole board with its white margin, sharp and evenly lit"


def find_board(grey: NDArray, board: Board) -> Detection | NotFound:
    """Find the board in a (H, W) uint8 or uint16 picture."""
    if not board.has_grid:
        return NotFound("the calibration's target is one of points, which pictures do not show")
    if board.coding:
        return find_coded_board(detect.eight_bits(grey), grey, board)
    detection = detect.find_corners(grey, board)
    if detection and detection.ambiguous:
        return NotFound(describe_two_boards(board))
    return (
        detection
        or find_partial_board(grey, board)
        or NotFound(f"no {board} board found: {CHECKERBOARD_ADVICE}")
    )


def describe_two_boards(board: Board) -> str:
    """Return the reason why a picture with two such boards is rejected."""
    return f"two {board} boards are seen: show one board alone"
