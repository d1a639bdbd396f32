"""The way of a person through a screen's poses: its size, where to put it, the patterns."""

import time
from collections.abc import Callable
from pathlib import Path

import cv2

from calib.errors import InputError
from calib.session.schema import Number
from capture.screen.aim import next_stance
from capture.screen.eye import Eye, PageLost, ScreenSize
from capture.screen.pitch import pitch_of_card, pitch_of_rulers
from capture.screen.points_session import PointsSession
from capture.screen.pose import PoseOutcome, check_period, take_pose
from capture.screen.timing import timing_sentences

PREVIEW_S = 0.25
"""The time in s between two pictures of the camera on the page."""
PREVIEW_PX = 640
"""px, the width of such a picture."""
MAX_RETAKES = 3
"""Times that a pose is taken again by itself, before the person is asked."""

Tell = Callable[[str], object]


class ScreenRecording:
    """Takes poses into a session until it has the wanted number of them."""

    def __init__(
        self,
        eye: Eye,
        session: PointsSession,
        poses: int,
        *,
        period: float | None,
        pitch: Number | None,
        tell: Tell,
        report_pose: Callable[[Path, str], object],
    ) -> None:
        """
        Args:
            poses: the number of poses that the session shall have.
            period: screen pixels in a fringe; None: the best of each pose.
            pitch: m, if it is known; else the page asks for it.
            tell: gets sentences for the person.
            report_pose: gets the file of each pose, and a sentence about it.
        """
        self._eye = eye
        self._session = session
        self._poses = poses
        self._period = period
        self._pitch = pitch
        self._tell = tell
        self._report_pose = report_pose
        self._timed: ScreenSize | None = None
        self._problem = ""

    def run(self) -> None:
        """Take poses until there are enough."""
        while len(self._session.pixels) < self._poses:
            try:
                size = self._eye.wait_for_page()
                self._check_size(size)
                pitch = self._find_pitch(size)
                self._aim()
                self._take(size, pitch)
            except PageLost as lost:
                self._say_problem(str(lost))
        self._say(
            "done", "All poses are there. Close this page: the next command is in the terminal."
        )

    def _check_size(self, size: ScreenSize) -> None:
        """Wait until the page is as large as the session's."""
        while self._session.screen not in (None, (size.width, size.height)):
            width, height = self._session.screen or (0, 0)
            sentence = (
                f"The page has {size.width}x{size.height} px where this session's screen has"
                f" {width}x{height}: make it full screen, and set its zoom as it was."
            )
            self._tell(sentence)
            self._say("wait", sentence)
            while True:  # PageLost comes out when the size changes
                self._eye.next_message(1e9)

    def _find_pitch(self, size: ScreenSize) -> Number:
        described = self._session.described
        pitch = described.pitch if described else self._pitch or self._ask_pitch()
        if self._period is not None:
            check_period(self._period, size, pitch)
        if described is None:
            picture = self._eye.look()
            height, width = picture.shape
            self._session.describe((width, height), pitch, self._eye.shutter)
            self._report_remarks()
        return pitch

    def _ask_pitch(self) -> Number:
        """Return the pitch that a person measures on the page."""
        self._say("size", "How large is a pixel of this screen?")
        while True:
            message = self._eye.next_message(1e9) or {}
            try:
                match message:
                    case {"card": {"px": [w, h]}}:
                        return pitch_of_card((_number(w), _number(h)))
                    case {"ruler": {"px": [w, h], "mm": [across, down]}}:
                        return pitch_of_rulers(
                            (_number(w), _number(h)), (_number(across), _number(down))
                        )
            except InputError as error:
                self._say_problem(str(error))

    def _aim(self) -> None:
        """Show the camera's picture until the person presses Take."""
        count = len(self._session.pixels)
        picture = self._eye.look()
        height, width = picture.shape
        self._check_picture(width, height)
        where = next_stance(self._session.pixels, width, height, count)
        sentence = f"Pose {count + 1} of {self._poses}. {where}"
        self._tell(sentence)
        self._say("aim", sentence)
        while True:
            message = self._eye.next_message(PREVIEW_S)
            if message and message.get("take") is True:
                self._problem = ""
                return
            preview = self._eye.look()
            scale = min(1.0, PREVIEW_PX / preview.shape[1])
            small = cv2.resize(preview, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            self._eye.page.send_picture(cv2.imencode(".jpg", small)[1].tobytes())

    def _check_picture(self, width: int, height: int) -> None:
        described = self._session.described
        if described and (described.camera.width, described.camera.height) != (width, height):
            camera = described.camera
            raise InputError(
                f"The camera's pictures have {width}x{height} px where"
                f" {self._session.session / 'session.yaml'} says {camera.width}x{camera.height}:"
                f" set the camera to that size (?size={camera.width}x{camera.height} after the"
                " source), or record another session."
            )

    def _take(self, size: ScreenSize, pitch: Number) -> None:
        """Take the patterns of a pose, again if it moved or was torn, and keep its points."""
        for _ in range(1 + MAX_RETAKES):
            self._say("take", "")
            start_s = time.monotonic()
            try:
                self._time(size)
                pose = take_pose(self._eye, size, pitch, self._period)
            except InputError as error:  # for the person, who then presses Take again
                self._say_problem(str(error))
                return
            if pose.points is not None:
                path = self._session.keep(pose.points, (size.width, size.height))
                seconds = time.monotonic() - start_s
                self._report_pose(path, f"{pose.sentence[:-1]}, in {seconds:.0f} s.")
                if pose.remark:
                    self._say_problem(pose.remark)
                return
            self._say_problem(pose.sentence)
            if pose.outcome is PoseOutcome.TORN:
                self._eye.wait_longer()
            elif pose.outcome is not PoseOutcome.MOVED:
                return

    def _time(self, size: ScreenSize) -> None:
        """Measure lag and flicker, once for each screen."""
        if self._timed == size:
            return
        timing = self._eye.measure_timing(size)
        for sentence in timing_sentences(timing, size.refresh_hz, self._eye.exposure_us):
            self._tell(sentence)
        self._timed = size

    def _say(self, phase: str, sentence: str) -> None:
        message = {"phase": phase, "sentence": sentence, "problem": self._problem}
        self._eye.page.send(message)

    def _say_problem(self, sentence: str) -> None:
        self._problem = sentence
        self._tell(sentence)
        self._eye.page.send({"problem": sentence})

    def _report_remarks(self) -> None:
        for remark in self._session.remarks:
            self._tell(remark)
        self._session.remarks.clear()


def _number(value: object) -> float:
    """Return a number that the page sends; 0 for anything else."""
    return float(value) if isinstance(value, int | float) else 0.0
