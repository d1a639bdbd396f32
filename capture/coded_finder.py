"""The finder of a board with markers in a live picture, which may show only a part of the board.

It reads the markers in a reduced picture. If they are small there, or none is found, it reads them
in a picture twice as fine. If there is none either, it reads a picture half as fine, which shows
markers that are out of focus. A ChArUco's markers stand free, so one threshold finds them where
they are not small. If the markers are not those of the declared board, the finder searches the
picture for the board that it does show. That takes as long as dozens of frames, so the search runs
at most a quarter of the time, and its message stands until the declared board is found.
"""

import time

import numpy as np
from numpy.typing import NDArray

from calib.corners.coded import find_coded_board, locate_live_corners
from calib.corners.detection import NotFound
from calib.corners.markers import THRESHOLD_WINDOWS, marker_cells
from calib.corners.other_coding import other_coding
from calib.corners.picture_scale import enlarge_corners, reduce_picture, reducing_factor
from calib.corners.pose_requirements import find_pose_problem
from calib.session.board import Board
from calib.session.coding import Charuco
from capture.coded_light import measure_light
from capture.frames import Frame
from capture.live_detection import LiveDetection, grey_of, mean_spacing

# px, the threshold window that finds a ChArUco's markers of 9 to 130 px as well as three do
SINGLE_WINDOW = (13,)
MIN_CELL = 2.2  # px of the reduced picture: markers with smaller cells are missed
# fraction of the board that a picture half as fine must show to be believed
MIN_COARSE_FRACTION = 0.4
REST_RATIO = 3.0  # the search for another board rests this many times as long as it took


class CodedFinder:
    """A finder of one board with markers; it remembers what it learned about a board that is not
    the declared one.
    """

    def __init__(self, board: Board) -> None:
        assert board.coding
        self._board = board
        self._windows = SINGLE_WINDOW if isinstance(board.coding, Charuco) else THRESHOLD_WINDOWS
        marker = board.coding.marker if isinstance(board.coding, Charuco) else board.square
        self._cell = marker / marker_cells(board.coding)  # m
        self._other_board = ""
        self._next_search_s = -np.inf

    def look(self, frame: Frame) -> LiveDetection:
        grey = grey_of(frame)
        height, width = grey.shape
        corners = self._find(grey)
        if isinstance(corners, NotFound):
            message = self._describe_other_board(grey) if corners.markers != "own" else ""
            return LiveDetection(
                None, width, height, frame.time_s, problem=message or corners.reason
            )
        self._other_board = ""
        visible = np.isfinite(corners[:, 0])
        if reason := find_pose_problem(visible, self._board):
            return LiveDetection(
                None,
                width,
                height,
                frame.time_s,
                partial_corners=corners[visible],
                problem=f"{reason}: show more of the {self._board} board",
            )
        light = measure_light(grey, corners, self._board)
        square = mean_spacing(corners.reshape(self._board.rows, self._board.columns, 2))
        return LiveDetection(
            corners,
            width,
            height,
            frame.time_s,
            square=square,
            margin=0.0,
            blur=light.blur,
            exposure=light.exposure,
        )

    def refine(self, frame: Frame, detection: LiveDetection) -> NDArray[np.float64] | None:
        """Return the corners as calib measures them, in the full picture. It shows markers that the
        reduced one does not; measuring takes a third of the time that reading them does.
        """
        if detection.corners is None:
            return None
        grey = grey_of(frame)
        refined = find_coded_board(grey, grey, self._board)
        if isinstance(refined, NotFound):
            return None
        too_few = find_pose_problem(np.isfinite(refined.corners[:, 0]), self._board)
        return None if too_few else refined.corners

    def _find(self, grey: NDArray[np.uint8]) -> NDArray[np.float64] | NotFound:
        """Return (count, 2) px in the full picture."""
        factor = reducing_factor(grey)
        corners = self._read_markers(grey, factor, self._windows)
        if isinstance(corners, NotFound) or self._cell_px(corners) < MIN_CELL * factor:
            fine_corners = self._read_markers(grey, max(factor // 2, 1), THRESHOLD_WINDOWS)
            corners = (
                fine_corners
                if isinstance(corners, NotFound) or not isinstance(fine_corners, NotFound)
                else corners
            )
        if isinstance(corners, NotFound) and corners.markers == "none":
            coarse_corners = self._read_markers(
                grey, min(2 * factor, *grey.shape), THRESHOLD_WINDOWS
            )
            if (
                not isinstance(coarse_corners, NotFound)
                and np.isfinite(coarse_corners[:, 0]).mean() >= MIN_COARSE_FRACTION
            ):
                return coarse_corners
        return corners

    def _read_markers(
        self, grey: NDArray[np.uint8], factor: int, windows: tuple[int, ...]
    ) -> NDArray[np.float64] | NotFound:
        corners = locate_live_corners(
            reduce_picture(grey, factor), self._board, windows, enlarge=factor == 1
        )
        return corners if isinstance(corners, NotFound) else enlarge_corners(corners, factor)

    def _cell_px(self, corners: NDArray[np.float64]) -> float:
        """Return the side of a marker's cell in px, the mean over (count, 2) px."""
        unit = 2 * self._board.half[0] / (self._board.columns - 1)
        return (
            self._cell
            / unit
            * mean_spacing(corners.reshape(self._board.rows, self._board.columns, 2))
        )

    def _describe_other_board(self, grey: NDArray[np.uint8]) -> str:
        """Describe the board that the picture shows instead of the declared one; empty if that is
        unknown.
        """
        start_s = time.monotonic()
        if start_s >= self._next_search_s:
            self._other_board = other_coding(
                [reduce_picture(grey, reducing_factor(grey))], self._board
            ).rstrip(".")
            end_s = time.monotonic()
            self._next_search_s = end_s + REST_RATIO * (end_s - start_s)
        return self._other_board
