"""Pictures without the declared board, searched for the board that they show in its place."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.corners.other_board import SAMPLE_SIZE, describe_other_board
from calib.session.board import Board
from capture.live_detection import grey_of
from capture.recording_loop import Step

INTERVAL_S = 0.5
"""The time in s from a kept frame of a stream to the next: the board should have moved."""


@dataclass(slots=True)
class OtherBoardSearch:
    """A sample of pictures without the declared board, as long as no picture shows it."""

    board: Board
    pictures: list[NDArray[np.uint8]] = field(default_factory=list)
    """(H, W) uint8 each, at most SAMPLE_SIZE."""
    is_board_right: bool = False
    """True once a picture has shown the declared board."""
    _last_s: float = -math.inf

    @property
    def is_full(self) -> bool:
        return len(self.pictures) >= SAMPLE_SIZE

    def add(self, step: Step) -> None:
        """Add the frame of a step, if it belongs to the sample."""
        if step.detection.corners is not None:
            self.is_board_right = True
            self.pictures.clear()
        frame = step.frame
        is_next = frame.isolated or frame.time_s - self._last_s >= INTERVAL_S
        if is_next and not (self.is_board_right or self.is_full):
            self._last_s = frame.time_s
            self.pictures.append(grey_of(frame))

    def describe(self) -> str:
        """Return the sentence about the board that the sample shows in place of the declared one,
        as `calib fit` says it; empty if there is none. It takes seconds. The next frames begin a
        new sample.
        """
        sample, self.pictures = self.pictures, []
        return describe_other_board(sample, self.board) if sample else ""
