"""Where a board with markers is in a live picture, as much of it as the picture shows.

Its markers are read in a reduced picture; where they are small there, or none is found, in one
twice as fine; and where there is none either, in one half as fine, which sees those that are out of
focus. A ChArUco's markers stand free, and one threshold finds them where they are not small. If
those that are read are not the declared board's, the picture is searched for what it shows instead:
that takes as long as dozens of frames, so it is done at most a quarter of the time, and what it
said is said until a board is found.
"""

import time

import numpy as np
from numpy.typing import NDArray

from calib.corners.coded import find_coded_board, locate_live_corners
from calib.corners.detection import NotFound
from calib.corners.markers import THRESHOLD_WINDOWS, marker_cells
from calib.corners.other_coding import other_coding
from calib.corners.picture_scale import enlarge_corners, live_factor, reduce_picture
from calib.corners.pose_requirements import find_pose_problem
from calib.session.board import Board
from calib.session.coding import Charuco
from capture.coded_light import measure_light
from capture.frames import Frame
from capture.sighting import Sighting, grey_of, side

QUICK = (13,)  # px, the threshold that finds a ChArUco's markers of 9 to 130 px as three do
CELL = 2.2  # px of the reduced picture: markers of smaller cells are missed
CLEARLY = 0.4  # of the board: so much of it a picture half as fine must show to be believed
RESTS = 3.0  # times as long as the search for another board took, it rests


class CodedFinder:
    """Keeps what it found out about a board that is not the declared one."""

    def __init__(self, board: Board) -> None:
        assert board.coding
        self._board = board
        self._windows = QUICK if isinstance(board.coding, Charuco) else THRESHOLD_WINDOWS
        marker = board.coding.marker if isinstance(board.coding, Charuco) else board.square
        self._cell = marker / marker_cells(board.coding)  # m
        self._other = ""
        self._rested_s = -np.inf

    def look(self, frame: Frame) -> Sighting:
        grey = grey_of(frame)
        height, width = grey.shape
        found = self._found(grey)
        if isinstance(found, NotFound):
            said = self._in_doubt(grey) if found.markers != "own" else ""
            return Sighting(None, width, height, frame.time_s, problem=said or found.reason)
        self._other = ""
        seen = np.isfinite(found[:, 0])
        if reason := find_pose_problem(seen, self._board):
            return Sighting(
                None,
                width,
                height,
                frame.time_s,
                part=found[seen],
                problem=f"{reason}: show more of the {self._board} board",
            )
        light = measure_light(grey, found, self._board)
        square = side(found.reshape(self._board.rows, self._board.columns, 2))
        return Sighting(
            found,
            width,
            height,
            frame.time_s,
            square=square,
            window=0.0,
            blur=light.blur,
            exposure=light.exposure,
        )

    def refine(self, frame: Frame, sighting: Sighting) -> NDArray[np.float64] | None:
        """As calib measures, in the whole picture: it shows markers that the reduced one does not,
        and to measure takes a third of the time that reading them does.
        """
        if sighting.corners is None:
            return None
        grey = grey_of(frame)
        found = find_coded_board(grey, grey, self._board)
        return (
            None
            if isinstance(found, NotFound)
            or find_pose_problem(np.isfinite(found.corners[:, 0]), self._board)
            else found.corners
        )

    def _found(self, grey: NDArray[np.uint8]) -> NDArray[np.float64] | NotFound:
        """(count, 2) px of the whole picture."""
        factor = live_factor(grey)
        found = self._in(grey, factor, self._windows)
        if isinstance(found, NotFound) or self._cell_px(found) < CELL * factor:
            finer = self._in(grey, max(factor // 2, 1), THRESHOLD_WINDOWS)
            found = (
                finer if isinstance(found, NotFound) or not isinstance(finer, NotFound) else found
            )
        if isinstance(found, NotFound) and found.markers == "none":
            coarser = self._in(grey, min(2 * factor, *grey.shape), THRESHOLD_WINDOWS)
            if not isinstance(coarser, NotFound) and np.isfinite(coarser[:, 0]).mean() >= CLEARLY:
                return coarser
        return found

    def _in(
        self, grey: NDArray[np.uint8], factor: int, windows: tuple[int, ...]
    ) -> NDArray[np.float64] | NotFound:
        found = locate_live_corners(
            reduce_picture(grey, factor), self._board, windows, enlarge=factor == 1
        )
        return found if isinstance(found, NotFound) else enlarge_corners(found, factor)

    def _cell_px(self, corners: NDArray[np.float64]) -> float:
        """Of a marker, in the mean over (count, 2) px."""
        unit = 2 * self._board.half[0] / (self._board.columns - 1)
        return self._cell / unit * side(corners.reshape(self._board.rows, self._board.columns, 2))

    def _in_doubt(self, grey: NDArray[np.uint8]) -> str:
        """What the picture shows instead of the declared board, if that is known."""
        begun = time.monotonic()
        if begun >= self._rested_s:
            self._other = other_coding(
                [reduce_picture(grey, live_factor(grey))], self._board
            ).rstrip(".")
            now = time.monotonic()
            self._rested_s = now + RESTS * (now - begun)
        return self._other
