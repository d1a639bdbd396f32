"""The choice of the live finder for a board."""

from calib.session.board import Board
from capture.coded_finder import CodedFinder
from capture.finder import Finder
from capture.live_detection import LiveFinder


def make_finder(board: Board) -> LiveFinder:
    return CodedFinder(board) if board.coding else Finder(board)
