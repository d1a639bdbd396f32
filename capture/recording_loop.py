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
from capture.gate import (
    GOOD_VIEW,
    HOLD_STILL,
    KNOWN_VIEW,
    MAX_PLAYED_SPEED,
    MOVING,
    FrameDecision,
    check_novelty,
    check_sharpness,
    judge_frame,
    measure_speed,
)
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
    played: bool = False
    """True for a video that was taken already. Of a view in which the board never stands still,
    the frame with the slowest board is kept, once the board has left it.
    """


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


@dataclass(frozen=True, slots=True, eq=False)
class _MovingView:
    """The slowest frame so far of a view in which the board moves."""

    frame: Frame
    detection: LiveDetection
    speed: float
    """px/s"""


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
    moving: _MovingView | None = None
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
            if picture:
                moving = None
            elif plan.played:
                if moving and _has_left(moving, detection):
                    step = _keep_moving(moving, finder, recorder, views, view_corners)
                    moving = None
                    if step:
                        views, last_s = step.view, step.frame.time_s
                        yield step
                        if views == plan.views:
                            return
                if decision.sentence == MOVING and frame.time_s - last_s >= plan.every_s:
                    moving = _slower(moving, frame, detection, previous)
        previous = detection
        yield Step(frame, detection, decision, picture, views)
        if views == plan.views and not remaining:
            return
    if moving and (step := _keep_moving(moving, finder, recorder, views, view_corners)):
        yield step


def _keep_moving(
    moving: _MovingView,
    finder: LiveFinder,
    recorder: Recorder,
    views: int,
    view_corners: list[NDArray[np.float64]],
) -> Step | None:
    """Keep a view in which the board moved; None if its corners cannot be measured, or the session
    has the view.
    """
    if not _is_new(moving.detection, view_corners):
        return None
    corners = finder.refine(moving.frame, moving.detection)
    if corners is None:
        return None
    picture = recorder.keep(moving.frame)
    view_corners.append(corners)
    decision = FrameDecision(True, GOOD_VIEW)
    return Step(moving.frame, moving.detection, decision, picture, views + 1)


def _has_left(moving: _MovingView, detection: LiveDetection) -> bool:
    """True if the board is not in that view any more."""
    return detection.corners is None or _is_new(detection, [_corners(moving.detection)])


def _is_new(detection: LiveDetection, view_corners: list[NDArray[np.float64]]) -> bool:
    return check_novelty(detection, None, view_corners) is None


def _slower(
    moving: _MovingView | None,
    frame: Frame,
    detection: LiveDetection,
    previous: LiveDetection | None,
) -> _MovingView | None:
    """Return the frame with the slower board. One that is too fast, or streaked, is none."""
    speed = measure_speed(detection, previous)
    if speed is None or speed > MAX_PLAYED_SPEED or check_sharpness(detection, previous, ()):
        return moving
    return moving if moving and moving.speed <= speed else _MovingView(frame, detection, speed)


def _corners(detection: LiveDetection) -> NDArray[np.float64]:
    assert detection.corners is not None
    return detection.corners


def detect_in_pictures(pictures: Iterable[Path], finder: LiveFinder) -> list[NDArray[np.float64]]:
    """Return (count, 2) px for every picture that shows the board: the views that a session has
    before it is continued.
    """
    detections = (
        finder.look(Frame(eight_bits(read_grey(picture)), 0, 0.0)) for picture in pictures
    )
    return [detection.corners for detection in detections if detection.corners is not None]
