"""One pose of a screen: all its patterns, while neither screen nor camera moves."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.fringes.decode import (
    DecodedScreen,
    PixelReason,
    ScreenPoints,
    decode_fringes,
    screen_points,
)
from calib.fringes.pattern import WHITE, FringePlan, Screen
from calib.session.schema import Number
from capture.screen.eye import Eye, ScreenSize
from capture.screen.motion import measure_motion
from capture.screen.period import (
    FringeTrial,
    best_period,
    judge_trial,
    reference_pattern,
    trial_pattern,
    trial_periods,
)
from capture.screen.timing import lit_pixels
from capture.screen.torn import torn_share

MAX_MOTION = 0.04
"""px between the first and the last picture of a pose: its points are then off by 0.02 px at most,
as one decoded point may be by noise (docs/screen-target.md).
"""
MAX_TORN = 0.03
"""The share of the screen in which a picture may show another pattern than its own: edges and
reflections make less.
"""
STILL_PICTURES = 40
"""Pairs of pictures in which the screen has to come to rest."""
MIN_POINTS = 300
"""Points of a pose that is kept: the fit averages more than 600."""
MIN_LOSS = 0.1
"""The part of the screen without points for one reason, above which a person is told."""

ADVICE = {
    PixelReason.DARK: "turn the screen to the camera, nearer, or lengthen the exposure",
    PixelReason.SATURATED: "shorten the exposure or dim the screen: white is saturated",
    PixelReason.DEFOCUSED: "the picture is too blurred for fringes: set the focus, or come nearer",
    PixelReason.MOIRE: "the screen's pixels beat with the camera's: step back, or tilt it less",
    PixelReason.MIXED: "bring the screen nearer, and take reflections and fingers out of view",
}


class PoseOutcome(IntEnum):
    """The end of a pose."""

    KEPT = 0
    RESTLESS = 1
    """The screen does not stand still."""
    MOVED = 2
    """The screen or the camera moved meanwhile."""
    UNSEEN = 3
    """Too few pixels have a place."""
    TORN = 4
    """A picture shows the pattern before its own, or two at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """What the pictures of a pose gave."""

    outcome: PoseOutcome
    sentence: str
    """For the person."""
    points: ScreenPoints | None = None
    """The points of a pose that is kept."""
    motion: float = 0.0
    """px between the first and the last picture."""
    period: float = 0.0
    """Screen pixels of the finest fringes."""
    remark: str = ""
    """The reason why a large part of the screen has no points; empty if none has."""


def take_pose(eye: Eye, size: ScreenSize, pitch: Number, period: float | None) -> Pose:
    """Take the pictures of a pose, and decode them.

    Args:
        period: screen pixels in a fringe; None: the best is looked for.

    Raises:
        InputError: the camera does not see the screen.
    """
    black = eye.photograph(size.flat(0))
    white = eye.photograph(size.flat(WHITE))
    lit = lit_pixels(black, white)
    reference = reference_pattern(size.width, size.height)
    first = eye.photograph(reference)
    for _ in range(STILL_PICTURES):
        previous, first = first, eye.photograph(reference)
        if measure_motion(previous, first, lit) < MAX_MOTION:
            break
    else:
        return Pose(
            PoseOutcome.RESTLESS,
            "The screen does not stand still: put it on a table or lean it against something.",
        )
    if period is None:
        trials = _try_periods(eye, size, black, white, lit)
        period = best_period(trials)
        if period is None:
            return Pose(PoseOutcome.UNSEEN, _trial_sentence(trials))
    plan = FringePlan(Screen(size.width, size.height, (pitch.value, pitch.value)), period)
    frames = [eye.photograph(pattern) for pattern in plan.patterns()]
    last = eye.photograph(reference)
    motion = measure_motion(first, last, lit)
    if motion > MAX_MOTION:
        sentence = f"Screen or camera moved by {motion:.2f} px meanwhile: this pose is taken again."
        return Pose(PoseOutcome.MOVED, sentence, motion=motion, period=period)
    torn = torn_share(frames, plan, black, white, lit)
    if torn > MAX_TORN:
        sentence = (
            f"A picture shows two patterns at once, in {100 * torn:.0f} % of the screen (the screen"
            " was late, or its picture tears): this pose is taken again, with more time for each"
            " pattern."
        )
        return Pose(PoseOutcome.TORN, sentence, motion=motion, period=period)
    decoded = decode_fringes(frames, plan)
    points = screen_points(decoded)
    if len(points.pixels) < MIN_POINTS:
        return Pose(
            PoseOutcome.UNSEEN, _unseen_sentence(decoded, lit), motion=motion, period=period
        )
    share = decoded.counts()[PixelReason.DECODED] / decoded.reason.size
    sentence = f"{len(points.pixels)} points in {100 * share:.0f} % of the picture."
    return Pose(PoseOutcome.KEPT, sentence, points, motion, period, loss_sentence(decoded, lit))


def _try_periods(
    eye: Eye,
    size: ScreenSize,
    black: NDArray[np.uint8],
    white: NDArray[np.uint8],
    lit: NDArray[np.bool_],
) -> list[FringeTrial]:
    """Try periods from the coarsest on, until finer ones tell less."""
    trials: list[FringeTrial] = []
    for period in trial_periods(size.width, size.height):
        fringes = eye.photograph(trial_pattern(period, size.width, size.height))
        trials.append(judge_trial(period, black, white, fringes, lit))
        if not trials[-1].is_usable or best_period(trials) != period:
            break
    return trials


def _trial_sentence(trials: list[FringeTrial]) -> str:
    is_blurred = trials and trials[0].camera_period > 0 and trials[0].modulation < 0.5
    reason = PixelReason.DEFOCUSED if is_blurred else PixelReason.MOIRE
    return f"No fringes of the screen can be made out: {ADVICE[reason]}."


def loss_sentence(decoded: DecodedScreen, lit: NDArray[np.bool_]) -> str:
    """Return the reason why a large part of the (H, W) lit pixels has no points; empty if none has.
    Edges and reflections are no such reason.
    """
    reasons = (PixelReason.SATURATED, PixelReason.DEFOCUSED, PixelReason.MOIRE)
    shares = {reason: float((decoded.reason[lit] == reason).mean()) for reason in reasons}
    largest = max(reasons, key=lambda reason: shares[reason])
    if shares[largest] < MIN_LOSS:
        return ""
    return f"{100 * shares[largest]:.0f} % of the screen has no points: {ADVICE[largest]}."


def _unseen_sentence(decoded: DecodedScreen, lit: NDArray[np.bool_]) -> str:
    counts = {reason: int(np.count_nonzero(lit & (decoded.reason == reason))) for reason in ADVICE}
    commonest = max(counts, key=lambda reason: counts[reason])
    return f"Too few pixels tell their place on the screen: {ADVICE[commonest]}."


def check_period(period: float, size: ScreenSize, pitch: Number) -> None:
    """Raise InputError if fringes of a period cannot be shown."""
    try:
        FringePlan(Screen(size.width, size.height, (pitch.value, pitch.value)), period)
    except InputError as error:
        raise InputError(f"--period: {error}") from error
