"""The loop from frames to pictures: detect, judge, keep. The code that shows it to a person is
built on top of it.
"""

import math
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.io.images import read_grey
from capture.frames import Frame
from capture.gate import HOLD_STILL, KNOWN_VIEW, MOVING, FrameDecision, check_novelty, judge_frame
from capture.live_detection import LiveDetection, LiveFinder
from capture.recorder import DROPPED, Recorder

UNMEASURED = FrameDecision(
    False, "Hold the board still and closer: its corners cannot be measured in the full picture."
)
SET_ASIDE = FrameDecision(
    False,
    f"This view was set aside: its picture is in {DROPPED}/. Move the board elsewhere, or go on"
    " with other pictures.",
)


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """The views to keep from a stream of frames."""

    views: int | None
    """The number of board poses after which the loop ends. None: it goes on."""
    burst: int = 1
    """The number of pictures of each view, as long as the board stays still."""
    every_s: float = 0.0
    """The minimum time in s from one view to the next."""


class ShutterButton:
    """The person's control of the loop while it runs, from any thread."""

    def __init__(self) -> None:
        self.automatic = True
        """True if the loop keeps good frames by itself."""
        self._pressed = threading.Event()

    def press(self) -> None:
        """Keep the next frame in which the board's corners can be measured, whatever the gate
        objects, unless it is a recorded picture whose view the session has already.
        """
        self._pressed.set()

    def take_press(self) -> bool:
        """Return True if the button was pressed since the last call."""
        pressed = self._pressed.is_set()
        self._pressed.clear()
        return pressed


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One frame, and its result."""

    frame: Frame
    detection: LiveDetection
    decision: FrameDecision
    picture: Path | None
    """The picture that holds it; None if it was not kept."""
    view: int
    """The number of views, with this one."""


def refusal_reason(step: Step) -> str:
    """Return the reason why a visible board was not kept; empty if it was kept, or if the person
    only has to hold it still.
    """
    accepted = step.decision.keep or step.decision.sentence in (HOLD_STILL, MOVING)
    return (
        "" if accepted or step.picture or step.detection.corners is None else step.decision.sentence
    )


def record_views(
    frames: Iterable[Frame],
    finder: LiveFinder,
    recorder: Recorder,
    plan: RecordingPlan,
    view_corners: list[NDArray[np.float64]],
    shutter: ShutterButton | None = None,
) -> Iterator[Step]:
    """Judge each frame, keep the good ones, and end after the planned views.

    `view_corners` has the (count, 2) px corners of the views that the session has already. The loop
    appends those of new views.
    """
    shutter = shutter or ShutterButton()
    previous: LiveDetection | None = None
    dropped_corners: list[NDArray[np.float64]] | None = None
    views, remaining, last_s = 0, 0, -math.inf
    for frame in frames:
        recorder.check(frame)
        detection = finder.look(frame)
        picture = None
        if frame.isolated:  # a photograph is not part of a burst
            remaining = 0
        if remaining:  # a burst: the same board again
            decision = judge_frame(detection, previous, ())
            remaining = remaining - 1 if decision.keep else 0
            if decision.keep:
                picture = recorder.keep(frame, same_view=True)
        else:
            # a folder, which plays back pictures that it gave before
            if frame.name and dropped_corners is None:
                dropped_corners = detect_in_pictures(recorder.set_aside, finder)
            candidates = [*view_corners, *(dropped_corners or ())] if frame.name else view_corners
            decision = judge_frame(detection, previous, candidates, isolated=frame.isolated)
            is_recorded = (
                bool(frame.name)
                and detection.corners is not None
                and check_novelty(detection, previous, candidates) is not None
            )
            if (
                is_recorded
                and decision.sentence == KNOWN_VIEW
                and check_novelty(detection, previous, view_corners) is None
            ):
                decision = SET_ASIDE
            wanted = detection.corners is not None and not is_recorded and shutter.take_press()
            if wanted or (
                shutter.automatic and decision.keep and frame.time_s - last_s >= plan.every_s
            ):
                corners = finder.refine(frame, detection)
                if corners is not None:
                    picture = recorder.keep(frame)
                    view_corners.append(corners)
                    views, remaining, last_s = views + 1, plan.burst - 1, frame.time_s
                elif detection.corners is not None:
                    decision = UNMEASURED
        previous = detection
        yield Step(frame, detection, decision, picture, views)
        if views == plan.views and not remaining:
            return


def detect_in_pictures(pictures: Iterable[Path], finder: LiveFinder) -> list[NDArray[np.float64]]:
    """Return (count, 2) px for every picture that shows the board: the views that a session has
    before it is continued.
    """
    detections = (
        finder.look(Frame(eight_bits(read_grey(picture)), 0, 0.0)) for picture in pictures
    )
    return [detection.corners for detection in detections if detection.corners is not None]
