"""Decide whether the pictures of a moment are worth keeping, and if not, what the person should do.

Pure: detections in, a sentence out. Where several cameras see the board, each must see it well. A
picture of one camera alone tells nothing about how the cameras are mounted, but it does about that
camera's lens and cover: it is worth keeping where the board covers a part of the picture that no
view has covered.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board
from calib.session.camera import Camera
from capture.coverage import covered_cells, visible_outline
from capture.gate import (
    CHECKS,
    GOOD_VIEW,
    KNOWN_VIEW,
    MOVING,
    NO_BOARD,
    Check,
    check_borders,
    check_detection,
    check_motion,
    check_novelty,
    judge_frame,
    measure_speed,
)
from capture.live_detection import LiveDetection

Corners = Mapping[str, NDArray[np.float64]]
"""The (count, 2) px corners that each camera saw at one moment, without the cameras that saw
none.
"""

MAX_MOTION = 0.2
"""px: the board's motion between the exposures of two cameras, twice the noise of a corner."""
MIN_NEW_CELLS = 0.25
"""The fraction of a board's area, in a picture of one camera alone, that no view has covered."""


@dataclass(frozen=True, slots=True)
class MomentDecision:
    """The pictures of a moment to keep."""

    cameras: tuple[str, ...]
    """The cameras whose pictures to keep; empty for none."""
    sentence: str
    """An instruction for the person."""


def judge_moment(
    detections: Mapping[str, LiveDetection],
    previous: Mapping[str, LiveDetection],
    views: Sequence[Corners],
    board: Board,
    *,
    isolated: bool = False,
    spread_s: float = 0.0,
) -> MomentDecision:
    """Decide which pictures of a moment to keep.

    Args:
        detections: the board in the frame of each camera.
        previous: the same at the moment before; empty if there is none.
        views: the corners of the moments that the session has.
        isolated: True for photographs, which no neighbouring frame shows to be still.
        spread_s: the time between the exposures, s.
    """
    visible = [name for name, detection in detections.items() if not _incomplete(detection)]
    if not visible:
        return MomentDecision((), _absent_sentence(detections))
    if len(visible) == 1:
        return _judge_single(visible[0], detections, previous, views, board, isolated=isolated)
    for check in CHECKS:
        if isolated and check is check_motion:
            continue
        if check is check_novelty:
            if _is_known(visible, detections, views):
                return MomentDecision((), KNOWN_VIEW)
            continue
        for name in visible:
            objection = _object(check, name, detections, previous)
            if objection:
                return MomentDecision((), objection)
    speeds = [measure_speed(detections[name], previous.get(name)) or 0.0 for name in visible]
    if not isolated and max(speeds) * spread_s > MAX_MOTION:
        return MomentDecision((), MOVING)
    return MomentDecision(tuple(visible), GOOD_VIEW)


def _object(
    check: Check,
    name: str,
    detections: Mapping[str, LiveDetection],
    previous: Mapping[str, LiveDetection],
) -> str:
    """Return the check's objection to a camera's frame with the camera's name; empty for none."""
    objection = check(detections[name], previous.get(name), ())
    if objection is None:
        return ""
    return objection if check is check_motion else f"{name}: {objection}"


def _is_known(
    cameras: Sequence[str], detections: Mapping[str, LiveDetection], views: Sequence[Corners]
) -> bool:
    """Return True if one moment of the session shows these cameras what they see now."""
    return any(
        all(
            name in view and check_novelty(detections[name], None, [view[name]]) is not None
            for name in cameras
        )
        for view in views
    )


def _absent_sentence(detections: Mapping[str, LiveDetection]) -> str:
    """Return the instruction if no camera sees the whole board: that of a camera which sees a
    part.
    """
    for name, detection in detections.items():
        objection = _incomplete(detection)
        if objection != NO_BOARD:
            return f"{name}: {objection}"
    return NO_BOARD


def _incomplete(detection: LiveDetection) -> str:
    """Return why a camera does not see the whole board; empty if it does."""
    return check_detection(detection, None, ()) or check_borders(detection, None, ()) or ""


def _judge_single(
    name: str,
    detections: Mapping[str, LiveDetection],
    previous: Mapping[str, LiveDetection],
    views: Sequence[Corners],
    board: Board,
    *,
    isolated: bool,
) -> MomentDecision:
    camera_views = [view[name] for view in views if name in view]
    decision = judge_frame(detections[name], previous.get(name), camera_views, isolated=isolated)
    if not decision.keep and decision.sentence != KNOWN_VIEW:
        return MomentDecision((), f"{name}: {decision.sentence}")
    if decision.keep and _new_fraction(detections[name], camera_views, board) >= MIN_NEW_CELLS:
        return MomentDecision((name,), f"Good for {name} alone: stay until it is taken.")
    absent = " and ".join(camera for camera in detections if camera != name)
    return MomentDecision(
        (),
        f"Only {name} sees the whole board, where its views have shown it: move it to where"
        f" {absent} sees it too, or to an edge of {name}'s picture.",
    )


def _new_fraction(
    detection: LiveDetection, views: Sequence[NDArray[np.float64]], board: Board
) -> float:
    """Return the fraction of the board's area in the picture that no view has covered."""
    camera = Camera(detection.width, detection.height)
    covered = np.zeros(())
    for view in views:
        covered = np.maximum(covered, covered_cells(visible_outline(view, board), camera))
    assert detection.corners is not None
    cells = covered_cells(visible_outline(detection.corners, board), camera)
    return float(np.maximum(cells - covered, 0).sum() / max(cells.sum(), 1e-9))
