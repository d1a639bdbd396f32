"""The counts of a stream, in constant memory."""

import time
from collections import deque

import numpy as np

RECENT = 1000
"""The frames whose latency gives the percentiles."""


class StreamStatistics:
    def __init__(self) -> None:
        self.frames = 0
        """The number of pictures that every target took."""
        self.skipped = 0
        """The number of frames that came while an earlier one was still on its way."""
        self.camera_losses = 0
        """The number of frames that the camera took and never sent, by its counter."""
        self.interruptions = 0
        """How often the camera was gone, and came back or was waited for."""
        self.depth_images: int | None = None
        """The number of depth images that were read; None for a stream at one depth."""
        self._start_s = time.monotonic()
        self._first_s = 0.0
        self._last_s = 0.0
        self._latencies_s: deque[float] = deque(maxlen=RECENT)
        self._maximum_s = 0.0

    def count_frame(self, arrival_s: float) -> None:
        """Count a frame that every target has just taken.

        Args:
            arrival_s: s of the monotonic clock, when the frame came from the camera.
        """
        self._last_s = time.monotonic()
        if not self.frames:
            self._first_s = self._last_s
        self.frames += 1
        latency_s = self._last_s - arrival_s
        self._latencies_s.append(latency_s)
        self._maximum_s = max(self._maximum_s, latency_s)

    @property
    def seconds(self) -> float:
        """The time in s since the beginning."""
        return time.monotonic() - self._start_s

    @property
    def rate(self) -> float:
        """Frames a second, from the first to the last; 0 for a single frame."""
        elapsed_s = self._last_s - self._first_s
        return (self.frames - 1) / elapsed_s if elapsed_s > 0 else 0.0

    def latency_ms(self, percent: float) -> float:
        """Return a percentile of the latency of the last RECENT frames, ms; 0 before the first."""
        return 1e3 * float(np.percentile(list(self._latencies_s) or [0.0], percent))

    def line(self) -> str:
        """Return the counts in one line."""
        losses = f", {self.camera_losses} lost by the camera" if self.camera_losses else ""
        gone = f", {_count(self.interruptions, 'interruption')}" if self.interruptions else ""
        frames = _count(self.frames, "frame")
        depths = (
            "" if self.depth_images is None else f", {_count(self.depth_images, 'depth image')}"
        )
        return (
            f"{frames}, {self.rate:.1f} a second, {self.latency_ms(50):.0f} ms from frame to"
            f" picture (95 %: {self.latency_ms(95):.0f} ms), {self.skipped} passed"
            f" over{losses}{gone}{depths}"
        )

    def as_json(self) -> dict[str, object]:
        return {
            "frames": self.frames,
            "frames_passed_over": self.skipped,
            "frames_lost": self.camera_losses,
            "interruptions": self.interruptions,
            "depth_images": self.depth_images,
            "seconds": self.seconds,
            "frames_per_second": self.rate,
            "latency_ms": {
                "median": self.latency_ms(50),
                "p95": self.latency_ms(95),
                "maximum": 1e3 * self._maximum_s,
            },
        }


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'s' * (number != 1)}"
