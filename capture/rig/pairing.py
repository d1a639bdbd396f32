"""The pictures of several cameras that belong together, by their time stamps or their names."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from capture.frames import Frame

TOLERANCE_FRACTION = 0.6
"""The tolerance between pictures that belong together, as a fraction of the interval from frame to
frame of the fastest camera. With half of it every picture of a slower camera has a partner, however
the cameras stand to each other; the rest is for unsteady clocks.
"""
MAX_TOLERANCE_S = 0.1
"""s: the largest tolerance. A board in a hand that seems still moves by 2 px in it."""
INTERVALS = 15
"""The number of frames whose median interval counts: dropped frames do not change it."""
MAX_PENDING = 30
"""The number of frames of a camera that wait for the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The frames that all cameras took at the same moment."""

    frames: Mapping[str, Frame]

    @property
    def time_s(self) -> float:
        """The time of the first frame, s."""
        return min(frame.time_s for frame in self.frames.values())

    @property
    def spread_s(self) -> float:
        """The time from the first frame to the last, s."""
        return max(frame.time_s for frame in self.frames.values()) - self.time_s

    @property
    def isolated(self) -> bool:
        """True for photographs: no neighbouring frame shows whether the board moved."""
        return any(frame.isolated for frame in self.frames.values())


class Pairing:
    """Takes the frames of each camera in their order, and gives the moments at which all cameras
    took one.
    """

    def __init__(self, cameras: Sequence[str], *, by_name: bool = False) -> None:
        """`by_name` is True for pictures without times: those of the same name belong together."""
        self.unpaired = 0
        """The number of frames at whose time another camera took none."""
        self._by_name = by_name
        self._pending = {name: deque[Frame]() for name in cameras}
        self._times = {name: deque[float](maxlen=INTERVALS + 1) for name in cameras}

    @property
    def tolerance_s(self) -> float | None:
        """The largest time between frames that belong together, s; None as long as the interval of
        some camera is unknown, or without times.
        """
        if self._by_name or min(map(len, self._times.values())) < 2:
            return None
        interval = min(float(np.median(np.diff(times))) for times in self._times.values())
        return min(TOLERANCE_FRACTION * interval, MAX_TOLERANCE_S)

    def add(self, camera: str, frame: Frame) -> list[Moment]:
        """Add the next frame of a camera, and return the moments that are complete now."""
        self._pending[camera].append(frame)
        self._times[camera].append(frame.time_s)
        if len(self._pending[camera]) > MAX_PENDING:
            self._pending[camera].popleft()
            self.unpaired += 1
        moments = []
        tolerance = self.tolerance_s
        while (self._by_name or tolerance is not None) and all(self._pending.values()):
            heads = {name: frames[0] for name, frames in self._pending.items()}
            moment = Moment(heads)
            if self._is_together(moment, tolerance or 0.0):
                moments.append(moment)
                for frames in self._pending.values():
                    frames.popleft()
            else:
                self._pending[min(heads, key=lambda name: self._key(heads[name]))].popleft()
                self.unpaired += 1
        return moments

    def _is_together(self, moment: Moment, tolerance: float) -> bool:
        if self._by_name:
            return len({PurePath(frame.name).stem for frame in moment.frames.values()}) == 1
        return moment.spread_s <= tolerance

    def _key(self, frame: Frame) -> float | str:
        return PurePath(frame.name).stem if self._by_name else frame.time_s
