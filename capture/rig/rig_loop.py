"""The loop from moments to pictures of a rig: detect, judge, keep."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.io.images import read_grey
from calib.session.board import Board
from capture.frames import Frame
from capture.live_detection import LiveDetection, LiveFinder
from capture.recording_loop import UNMEASURED, RecordingPlan, ShutterButton
from capture.rig.moment_gate import Corners, MomentDecision, judge_moment
from capture.rig.pairing import Moment
from capture.rig.rig_recorder import RigRecorder


@dataclass(frozen=True, slots=True, eq=False)
class RigStep:
    """One moment, and its result."""

    moment: Moment
    detections: Mapping[str, LiveDetection]
    decision: MomentDecision
    pictures: Mapping[str, Path]
    """The picture that holds the frame of a camera; empty if none was kept."""
    views: int
    """The number of views that several cameras share, with this one."""
    singles: int
    """The number of views of one camera alone, with this one."""


def record_moments(
    moments: Iterable[Moment],
    finders: Mapping[str, LiveFinder],
    board: Board,
    recorder: RigRecorder,
    plan: RecordingPlan,
    views: list[Corners],
    shutter: ShutterButton | None = None,
) -> Iterator[RigStep]:
    """Judge each moment, keep the good ones, and end after the planned views that several cameras
    share.

    `views` has the corners of the moments that the rig's folder has already. The loop appends those
    of new ones.
    """
    shutter = shutter or ShutterButton()
    previous: Mapping[str, LiveDetection] = {}
    count, singles, remaining, last_s = 0, 0, 0, -math.inf
    burst: tuple[str, ...] = ()
    for moment in moments:
        recorder.check(moment)
        detections = {name: finders[name].look(frame) for name, frame in moment.frames.items()}
        history = () if remaining else views
        decision = judge_moment(
            detections,
            previous,
            history,
            board,
            isolated=moment.isolated,
            spread_s=moment.spread_s,
        )
        pictures: dict[str, Path] = {}
        if moment.isolated:
            remaining = 0
        if remaining:
            remaining = remaining - 1 if decision.cameras == burst else 0
            if decision.cameras == burst:
                pictures = recorder.keep(moment, burst, same_view=True)
        else:
            visible = tuple(name for name, look in detections.items() if look.corners is not None)
            cameras: tuple[str, ...] = ()
            if visible and shutter.take_press():
                cameras = visible
            elif shutter.automatic and moment.time_s - last_s >= plan.every_s:
                cameras = decision.cameras
            if cameras:
                corners = _refine(moment, cameras, finders, detections)
                if len(corners) == len(cameras):
                    pictures = recorder.keep(moment, cameras)
                    views.append(corners)
                    count += len(cameras) > 1
                    singles += len(cameras) == 1
                    burst, remaining, last_s = cameras, plan.burst - 1, moment.time_s
                else:
                    decision = MomentDecision((), UNMEASURED.sentence)
        previous = detections
        yield RigStep(moment, detections, decision, pictures, count, singles)
        if count == plan.views and not remaining:
            return


def record_all(
    moments: Iterable[Moment], recorder: RigRecorder, views: int | None
) -> Iterator[RigStep]:
    """Keep each moment, whatever is in it, and end after this many; None goes on."""
    for count, moment in enumerate(islice(moments, views), start=1):
        cameras = tuple(moment.frames)
        decision = MomentDecision(cameras, "")
        yield RigStep(moment, {}, decision, recorder.keep(moment, cameras), count, 0)


def _refine(
    moment: Moment,
    cameras: tuple[str, ...],
    finders: Mapping[str, LiveFinder],
    detections: Mapping[str, LiveDetection],
) -> dict[str, NDArray[np.float64]]:
    """Return the measured corners of each camera, without those that cannot be measured."""
    refined = {
        name: finders[name].refine(moment.frames[name], detections[name]) for name in cameras
    }
    return {name: corners for name, corners in refined.items() if corners is not None}


def detect_in_rig(recorder: RigRecorder, finders: Mapping[str, LiveFinder]) -> list[Corners]:
    """Return the corners of the moments that a rig's folder has: pictures of one name belong to
    one moment.
    """
    moments: dict[str, dict[str, NDArray[np.float64]]] = {}
    for name, camera in recorder.recorders.items():
        for picture in camera.pictures:
            frame = Frame(eight_bits(read_grey(picture)), 0, 0.0)
            corners = finders[name].look(frame).corners
            if corners is not None:
                moments.setdefault(picture.stem, {})[name] = corners
    return [moments[stem] for stem in sorted(moments)]
