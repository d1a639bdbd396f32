"""The live finder of a board, of whatever kind."""

from calib.session.board import Board
from capture.coded_finder import CodedFinder
from capture.finder import Finder
from capture.sighting import LiveFinder


def finder_of(board: Board) -> LiveFinder:
    return CodedFinder(board) if board.coding else Finder(board)
