"""Decide whether a frame is worth keeping, and if not, what the person should do first.

The functions are pure: detections in, a sentence out. The checks run in the order in which a person
must fix the problems, and the first check that objects gives the sentence.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.frames import PAUSE_S
from capture.live_detection import LiveDetection

# squares: the next corner of a board that is only partly visible would lie beyond a border that is
# nearer than this
BORDER_SQUARES = 1.5
# fraction of the white area: above it, more than one white square in twenty is saturated, and the
# corners around it are biased
MAX_CLIPPED = 0.05
MIN_CONTRAST = 40.0  # grey levels: ten times the noise of a small sensor at a high gain
# px/s: a motion of this speed skews a picture by 1 px in the 47 ms in which an imx219 reads its
# rows; the poses absorb all but 0.02 px of that (median of 200)
MAX_SPEED = 20.0
# px/s, of a video that was taken already: nobody can hold the board still any more, and the poses
# absorb all but some tenths of a pixel of the skew. Its blur is judged all the same
MAX_PLAYED_SPEED = 200.0
# px: the board moved this far while the shutter was open, and as far again while the rows were
# read, whatever MAX_SPEED says
MAX_STREAK = 2.0
# px: at this blur, the corners of squares of 15 to 28 px are a third worse than in focus; at 2.5 px
# they are twice as bad; at 3 px some are not found
MAX_BLUR_SIGMA = 2.0
MIN_SHIFT = 1.0  # squares, RMS: below it, the corners look through nearly the same glass
# squares, RMS after removing shift, rotation and scale: the change that a tilt by about 15 degrees
# makes
MIN_SHAPE_CHANGE = 0.1
# fraction of the visible corners: a view that shows more than the remainder in addition is new
MIN_SHARED = 0.8
MIN_AFFINE_CORNERS = 4  # corners that determine an affine motion and leave a residual

NO_BOARD = "No board in view: hold the whole board in the picture, evenly lit and in focus."
WRONG_BOARD = (
    "The board in view has more corners than the board that you described: show that board, or"
    " correct its columns and rows."
)
HIDDEN_BOARD = (
    "Only a part of the board can be made out: uncover all of it, and turn glare and shadow away."
)
GLARE = "White squares are clipped: lower exposure or gain, or turn glare away."
DARK = (
    "White hardly stands out from black: add light, raise exposure or gain, or take shadows from"
    " the board."
)
KNOWN_VIEW = (
    "This view is already there: move the board elsewhere, tilt it, or change its distance."
)
HOLD_STILL = "Hold the board still for a moment."
MOVING = "The board moves: hold it still."
MOTION_BLUR = (
    "Motion streaks the picture: hold the board still, or add light and shorten the exposure."
)
OUT_OF_FOCUS = "The board is out of focus: set the focus to its distance, or clean lens and cover."
GOOD_VIEW = "Good view: stay until it is taken, then move on."

SIDE_NAMES = (("left", "right"), ("top", "bottom"))


@dataclass(frozen=True, slots=True)
class FrameDecision:
    keep: bool
    sentence: str
    """An instruction for the person."""


def judge_frame(
    detection: LiveDetection,
    previous: LiveDetection | None,
    views: Sequence[NDArray[np.float64]],
    *,
    isolated: bool = False,
) -> FrameDecision:
    """Decide whether to keep a frame.

    Args:
        detection: the board in this frame.
        previous: the board in the frame before. None if there is no such frame: then nobody knows
            whether the board is still.
        views: (count, 2) px each, the corners of the session's views; NaN where not visible.
        isolated: True for a single photograph: no neighbouring frame shows its motion, so only its
            blur can.
    """
    for check in CHECKS:
        objection = (
            None if isolated and check is check_motion else check(detection, previous, views)
        )
        if objection is not None:
            return FrameDecision(False, objection)
    return FrameDecision(True, GOOD_VIEW)


def check_detection(
    detection: LiveDetection, _previous: LiveDetection | None, _views: Sequence[NDArray[np.float64]]
) -> str | None:
    if detection.corners is not None:
        return None
    if detection.problem:
        return f"{detection.problem[0].upper()}{detection.problem[1:]}."
    if detection.partial_corners is None:
        return NO_BOARD
    if detection.too_large:
        return WRONG_BOARD
    return (
        _check_cut_off(detection, detection.partial_corners, BORDER_SQUARES * detection.square)
        or HIDDEN_BOARD
    )


def check_borders(
    detection: LiveDetection, _previous: LiveDetection | None, _views: Sequence[NDArray[np.float64]]
) -> str | None:
    return _check_cut_off(detection, _corners(detection), detection.margin)


def check_exposure(
    detection: LiveDetection, _previous: LiveDetection | None, _views: Sequence[NDArray[np.float64]]
) -> str | None:
    if detection.exposure is None or detection.exposure.contrast < MIN_CONTRAST:
        return DARK
    return GLARE if detection.exposure.clipped > MAX_CLIPPED else None


def check_novelty(
    detection: LiveDetection, _previous: LiveDetection | None, views: Sequence[NDArray[np.float64]]
) -> str | None:
    corners = _corners(detection)
    for view in views:
        shared = np.isfinite(corners[:, 0]) & np.isfinite(view[:, 0])
        if shared.sum() < MIN_SHARED * np.isfinite(corners[:, 0]).sum():
            continue
        current, recorded = corners[shared], view[shared]
        if (
            _rms(current - recorded) < MIN_SHIFT * detection.square
            and _rms(_shape_change(current, recorded)) < MIN_SHAPE_CHANGE * detection.square
        ):
            return KNOWN_VIEW
    return None


def check_motion(
    detection: LiveDetection, previous: LiveDetection | None, _views: Sequence[NDArray[np.float64]]
) -> str | None:
    speed = measure_speed(detection, previous)
    if speed is None:
        return HOLD_STILL
    return MOVING if speed > MAX_SPEED else None


def measure_speed(detection: LiveDetection, previous: LiveDetection | None) -> float | None:
    """Return the speed of the board's fastest corner, px/s; None if the frame before does not
    tell.
    """
    if (
        previous is None
        or previous.corners is None
        or not 0 < detection.time_s - previous.time_s < PAUSE_S
    ):
        return None
    shared = np.isfinite(_corners(detection)[:, 0]) & np.isfinite(previous.corners[:, 0])
    if shared.sum() < MIN_AFFINE_CORNERS:
        return None
    corners, earlier = _corners(detection)[shared], previous.corners[shared]
    terms = np.column_stack([corners - corners.mean(0), np.ones(len(corners))])
    smooth = (
        terms @ np.linalg.lstsq(terms, corners - earlier, rcond=None)[0]
    )  # an affine motion averages out the noise of single corners
    fastest = np.linalg.norm(smooth, axis=1).max() / (detection.time_s - previous.time_s)
    return float(fastest)


def check_sharpness(
    detection: LiveDetection, _previous: LiveDetection | None, _views: Sequence[NDArray[np.float64]]
) -> str | None:
    if detection.blur is None or detection.blur.sigma > MAX_BLUR_SIGMA:
        return OUT_OF_FOCUS
    return MOTION_BLUR if detection.blur.streak > MAX_STREAK else None


Check = Callable[[LiveDetection, LiveDetection | None, Sequence[NDArray[np.float64]]], str | None]
"""A check returns an instruction, or None if it has no objection. It may rely on the checks before
it in CHECKS.
"""

CHECKS: tuple[Check, ...] = (
    check_detection,
    check_borders,
    check_exposure,
    check_novelty,
    check_motion,
    check_sharpness,
)
"""The checks, in the order in which a person must fix the problems: holding still a view that the
session has already is useless.
"""


def _corners(detection: LiveDetection) -> NDArray[np.float64]:
    if detection.corners is None:
        raise ValueError("This check is for boards that were found.")
    return detection.corners


def _check_cut_off(detection: LiveDetection, points: NDArray, min_distance: float) -> str | None:
    """Return an instruction if one of the (n, 2) px points is nearer to a border than this; else
    None.
    """
    minimum, maximum = np.nanmin(points, 0), np.nanmax(points, 0)
    gaps = np.array(
        [minimum, (detection.width - 1, detection.height - 1) - maximum]
    ).T  # (x and y, start and end)
    axis, end = np.unravel_index(gaps.argmin(), gaps.shape)
    if gaps[axis, end] >= min_distance:
        return None
    sides = SIDE_NAMES[axis]
    return (
        f"The board is cut off at the {sides[end]}: move it away from the picture's {sides[end]}"
        " border."
    )


def _shape_change(corners: NDArray, recorded: NDArray) -> NDArray[np.float64]:
    """Return (count, 2) px, the residual of these corners after a shift, a rotation and a scaling
    of the other view's corners.
    """
    target = (corners - corners.mean(0)) @ (1, 1j)  # (count,) complex
    source = (recorded - recorded.mean(0)) @ (1, 1j)
    residual = np.asarray(target - source * (np.vdot(source, target) / np.vdot(source, source)))
    return np.stack([residual.real, residual.imag], -1)


def _rms(vectors: NDArray) -> float:
    """Return the root mean square of the lengths of (n, 2) vectors."""
    return float(np.sqrt((vectors**2).sum(-1).mean()))
