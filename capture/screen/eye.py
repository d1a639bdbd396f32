"""The camera and the page together: show a pattern, and take the picture that was exposed after
it.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.fringes.pattern import WHITE, ScreenPattern
from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.reader import Reader
from capture.screen.page import Event, PatternPage
from capture.screen.timing import (
    CHANGES,
    MIN_PICTURES,
    WATCHED_S,
    ScreenTiming,
    measure_timing,
)

ANSWER_S = 10.0
"""The time in s in which the page has to say that it has shown a pattern."""
LONGER = 1.5
"""The factor of the time for a pattern, once a picture was torn."""
POLL_S = 0.2
"""The time in s between two looks whether the program shall end."""
MAX_PIXELS_ALONG = 32768
"""px, the maximum of a screen's width and height: a page that says more is not ours."""
REFRESH_HZ = (10.0, 1000.0)
"""The limits of a screen's refresh rate."""


class PageLost(Exception):
    """The page has gone, or does not answer. The message is a sentence for the person."""


class Stopped(Exception):
    """A person has ended the program."""


@dataclass(frozen=True, slots=True)
class ScreenSize:
    """The screen as the page knows it."""

    width: int
    """px"""
    height: int
    """px"""
    refresh_hz: float

    @staticmethod
    def of(message: Mapping[str, object]) -> "ScreenSize | None":
        """Read the page's first message; None if it is another."""
        match message.get("screen"):
            case {"width": int(width), "height": int(height), "refresh_hz": int() | float() as hz}:
                fits = all(64 <= size <= MAX_PIXELS_ALONG for size in (width, height))
                if fits and REFRESH_HZ[0] <= hz <= REFRESH_HZ[1]:
                    return ScreenSize(width, height, float(hz))
        return None

    def flat(self, level: int) -> ScreenPattern:
        """Return a screen of one level."""
        return ScreenPattern(
            np.full(self.width, level, np.uint8), np.full(self.height, WHITE, np.uint8)
        )


class Eye:
    """One page and one camera. PageLost and Stopped can come out of every method."""

    def __init__(self, reader: Reader, page: PatternPage, is_stopped: Callable[[], bool]) -> None:
        self.page = page
        self.size: ScreenSize | None = None
        """The screen of the page that is open; None: no page is."""
        self.exposure_us: float | None = None
        """The exposure that the camera tells; None: it tells none."""
        self._reader = reader
        self._frames: Iterator[Frame] = iter(reader)
        self._is_stopped = is_stopped
        self._page_number = 0
        self._number = 0
        self._message_s = 0.0
        self._settle_s = 0.0

    @property
    def shutter(self) -> Shutter | None:
        """The shutter of the camera's sensor, if its driver names it."""
        return self._reader.source.shutter

    def wait_for_page(self) -> ScreenSize:
        """Return the screen of the page that is open, or of the next one."""
        while self.size is None:
            self.next_message(math.inf)
        return self.size

    def next_message(self, timeout_s: float) -> Mapping[str, object] | None:
        """Return what the page sends next; None if it sends nothing in time, or a size alone.

        Raises:
            PageLost: the page has gone, was opened anew, or its screen has another size.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            if self._is_stopped():
                raise Stopped
            event = self.page.next_event(max(min(POLL_S, end_s - time.monotonic()), 0.0))
            if event is not None:
                self._message_s = event.time_s
                return self._admit(event)
            if time.monotonic() >= end_s:
                return None

    def show(self, pattern: ScreenPattern) -> float:
        """Show a pattern, and return the time (monotonic clock, s) of the page's answer."""
        self._number += 1
        self.page.show(self._number, pattern)
        end_s = time.monotonic() + ANSWER_S
        while True:
            message = self.next_message(end_s - time.monotonic())
            if message is not None and message.get("shown") == self._number:
                return self._message_s
            if time.monotonic() >= end_s:
                raise PageLost(
                    "The page does not answer: bring it to the front, and keep the screen awake."
                )

    def photograph(self, pattern: ScreenPattern) -> NDArray[np.uint8]:
        """Show a pattern, and return the (H, W) grey picture that was exposed after it."""
        shown_s = self.show(pattern)
        return self.look(shown_s + self._settle_s)

    def look(self, after_s: float = -math.inf) -> NDArray[np.uint8]:
        """Return the first grey picture whose exposure began after a time (monotonic clock, s)."""
        return _grey(self._frame(after_s))

    def measure_timing(self, size: ScreenSize) -> ScreenTiming:
        """Show white and black in turn, and wait from now on for as long as a change takes.

        Raises:
            InputError: the camera does not see the screen, or its pictures do not stop to change.
        """
        previous = self.look(self.show(size.flat(0)) + WATCHED_S)
        measured = []
        for change in range(CHANGES):
            shown_s = self.show(size.flat(0 if change % 2 else WHITE))
            pictures = []
            times_s: list[float] = []
            while not times_s or times_s[-1] < WATCHED_S or len(times_s) < MIN_PICTURES:
                frame = self._frame(shown_s)
                pictures.append(_grey(frame))
                times_s.append(frame.time_s - shown_s)
            measured.append(measure_timing(previous, pictures, times_s))
            previous = pictures[-1]
        longest = ScreenTiming(
            max(timing.lag_s for timing in measured), max(timing.flicker for timing in measured)
        )
        self._settle_s = longest.settle_s
        return longest

    def wait_longer(self) -> None:
        """Wait for each pattern for one and a half times as long from now on."""
        self._settle_s *= LONGER

    def _frame(self, after_s: float) -> Frame:
        for frame in self._frames:
            self._read_waiting()
            if frame.time_s >= after_s:
                exposure = frame.metadata.get("exposure_us")
                self.exposure_us = exposure if isinstance(exposure, float) else None
                return frame
        if self._is_stopped():
            raise Stopped
        raise CaptureError(
            "The camera sends no more pictures: check its cable, and run the same command to"
            " continue."
        )

    def _read_waiting(self) -> None:
        """Read what the page has sent meanwhile."""
        while (event := self.page.next_event(0)) is not None:
            self._admit(event)
        if self._is_stopped():
            raise Stopped

    def _admit(self, event: Event) -> Mapping[str, object] | None:
        if event.page < self._page_number:  # a page that another one has replaced
            return None
        if event.page > self._page_number:
            was_open = self.size is not None
            self._page_number, self.size = event.page, ScreenSize.of(event.message)
            if was_open:
                raise PageLost("The page was opened anew.")
            return None
        if not event.message:
            self.size = None
            raise PageLost("The page was closed: open its address again, and nothing is lost.")
        size = ScreenSize.of(event.message)
        if size is None:
            return event.message
        changed = self.size is not None and (size.width, size.height) != (
            self.size.width,
            self.size.height,
        )
        self.size = size
        if changed:
            raise PageLost("The size of the page has changed: this pose is taken again.")
        return None


def _grey(frame: Frame) -> NDArray[np.uint8]:
    pixels = frame.pixels
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
