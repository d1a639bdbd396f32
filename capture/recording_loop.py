"""The loop from frames to pictures: look, judge, keep. What shows it to a person stands above
it.
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
from capture.gate import KNOWN, MOVING, WAIT, Verdict, judge, new
from capture.recorder import DROPPED, Recorder
from capture.sighting import LiveFinder, Sighting

UNMEASURED = Verdict(
    False, "Hold the board still and closer: its corners cannot be measured in the whole picture."
)
SET_ASIDE = Verdict(
    False,
    f"This view was set aside: its picture is in {DROPPED}/. Move the board elsewhere, or go on"
    " with other pictures.",
)


@dataclass(frozen=True, slots=True)
class Plan:
    """What to keep of a stream of frames."""

    views: int | None
    """Poses of the board, after which the loop ends. None: it goes on."""
    burst: int = 1
    """Pictures of each, as long as the board stays still."""
    every_s: float = 0.0
    """The least time from one view to the next."""


class Shutter:
    """What a person wishes of the loop while it runs, from any thread."""

    def __init__(self) -> None:
        self.automatic = True
        """Whether good frames are kept by themselves."""
        self._pressed = threading.Event()

    def press(self) -> None:
        """Keep the next frame in which the board's corners can be measured, whatever else is wrong
        with it; but no recorded picture whose view is there already.
        """
        self._pressed.set()

    def pressed(self) -> bool:
        """Whether it was pressed since this was last asked."""
        was = self._pressed.is_set()
        self._pressed.clear()
        return was


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One frame, and what became of it."""

    frame: Frame
    sighting: Sighting
    verdict: Verdict
    picture: Path | None
    """Where it was kept; None if it was not."""
    view: int
    """How many views there are, with this one."""


def refusal(step: Step) -> str:
    """Why a board that is in view was not kept; empty where it was, or where it only has to be held
    still.
    """
    waits = step.verdict.keep or step.verdict.sentence in (WAIT, MOVING)
    return "" if waits or step.picture or step.sighting.corners is None else step.verdict.sentence


def record(
    frames: Iterable[Frame],
    finder: LiveFinder,
    recorder: Recorder,
    plan: Plan,
    kept: list[NDArray[np.float64]],
    shutter: Shutter | None = None,
) -> Iterator[Step]:
    """Judge each frame, keep the good ones, and end after the planned views.

    `kept` has the (count, 2) px corners of the views that the session has already; those of new
    views are added to it.
    """
    shutter = shutter or Shutter()
    before: Sighting | None = None
    aside: list[NDArray[np.float64]] | None = None
    views, left, last_s = 0, 0, -math.inf
    for frame in frames:
        recorder.check(frame)
        now = finder.look(frame)
        picture = None
        if frame.alone:  # it is no part of a burst
            left = 0
        if left:  # a burst: the same board once more
            verdict = judge(now, before, ())
            left = left - 1 if verdict.keep else 0
            if verdict.keep:
                picture = recorder.keep(frame, same_view=True)
        else:
            if frame.name and aside is None:  # a folder, which gives once more what it gave before
                aside = corners_of(recorder.set_aside, finder)
            known = [*kept, *(aside or ())] if frame.name else kept
            verdict = judge(now, before, known, alone=frame.alone)
            there = (
                bool(frame.name) and now.corners is not None and new(now, before, known) is not None
            )
            if there and verdict.sentence == KNOWN and new(now, before, kept) is None:
                verdict = SET_ASIDE
            asked = now.corners is not None and not there and shutter.pressed()
            if asked or (
                shutter.automatic and verdict.keep and frame.time_s - last_s >= plan.every_s
            ):
                corners = finder.refine(frame, now)
                if corners is not None:
                    picture = recorder.keep(frame)
                    kept.append(corners)
                    views, left, last_s = views + 1, plan.burst - 1, frame.time_s
                elif now.corners is not None:
                    verdict = UNMEASURED
        before = now
        yield Step(frame, now, verdict, picture, views)
        if views == plan.views and not left:
            return


def corners_of(pictures: Iterable[Path], finder: LiveFinder) -> list[NDArray[np.float64]]:
    """(count, 2) px for every picture in which the board is seen: what a session has before it is
    continued.
    """
    sightings = (finder.look(Frame(eight_bits(read_grey(picture)), 0, 0.0)) for picture in pictures)
    return [sighting.corners for sighting in sightings if sighting.corners is not None]
