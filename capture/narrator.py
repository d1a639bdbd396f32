"""The output of a recording without a screen: kept pictures on stdout; instructions and remarks on
stderr.
"""

import sys
from pathlib import Path

from calib.errors import harmless
from calib.io.numerals import counted
from capture.reader import Reader
from capture.recorder import Recorder
from capture.recording_loop import Step


class Narrator:
    def __init__(
        self, reader: Reader, recorder: Recorder, views: int | None, *, json: bool
    ) -> None:
        """`views` is the wanted number of views, None for no limit; with `json`, stdout carries
        only the summary.
        """
        self.sentence = ""
        """The instruction for the person."""
        self.judged = 0
        """The number of judged frames."""
        self.views = 0
        self.pictures: list[Path] = []
        self._reader = reader
        self._recorder = recorder
        self._wanted = views
        self._json = json
        self._reported = 0
        for remark in reader.source.remarks:
            _remark(remark)

    def report_step(self, step: Step) -> None:
        """Print the picture if the frame was kept; else the decision: of a photograph with its
        name, of a stream if it differs from the last one.
        """
        self.judged += 1
        if step.picture:
            self.report_picture(step.picture, step.view)
        elif step.frame.isolated:
            _remark(f"{step.frame.name}: {step.decision.sentence}")
        elif step.decision.sentence != self.sentence:
            _remark(step.decision.sentence)
        self.sentence = step.decision.sentence

    def report_picture(self, picture: Path, view: int) -> None:
        self.pictures.append(picture)
        self.views = view
        if not self._json:
            of = f" of {self._wanted}" if self._wanted else ""
            print(harmless(f"{picture}  view {view}{of}"), flush=True)
        for remark in self._recorder.remarks[self._reported :]:
            _remark(remark)
        self._reported = len(self._recorder.remarks)

    def print_summary(self) -> None:
        print(harmless(f"{self._summary()} in {self._recorder.session}."))

    def report_safety(self) -> None:
        """Say, before an error is printed, that the pictures so far are safe."""
        if self.pictures:
            _remark(f"Safe in {self._recorder.session}: {self._summary()}.")

    def as_json(self, *, ended: str) -> dict[str, object]:
        return {
            "session": str(self._recorder.session),
            "pictures": [
                str(picture.relative_to(self._recorder.session)) for picture in self.pictures
            ],
            "views": self.views,
            "frames_judged": self.judged,
            "frames_passed_over": self._reader.skipped,
            "frames_lost": self._reader.lost,
            "remarks": [*self._reader.source.remarks, *self._recorder.remarks],
            "ended": ended,
        }

    def _summary(self) -> str:
        judged = f"{counted(self.judged or len(self.pictures), 'frame')} taken"
        skipped = f", {self._reader.skipped} passed over meanwhile" if self._reader.skipped else ""
        lost_frames = f", {self._reader.lost} lost by the camera" if self._reader.lost else ""
        return (
            f"{counted(self.views, 'view')} with {counted(len(self.pictures), 'picture')}"
            f" ({judged}{skipped}{lost_frames})"
        )


class SilenceRemarks:
    """Remarks that no picture comes: at the first silence, then at each that is twice as long as
    those before.
    """

    def __init__(self, prefix: str = "") -> None:
        """`prefix` begins each remark, such as the name of a camera."""
        self._prefix = prefix
        self._longest = 0.0

    def __call__(self, seconds: float) -> None:
        if seconds >= 2 * self._longest:
            self._longest = seconds
            _remark(f"{self._prefix}{silence_sentence(seconds)}")


def silence_sentence(seconds: float) -> str:
    return f"No picture has come for {seconds:.0f} s: waiting for the next one."


def _remark(sentence: str) -> None:
    print(harmless(sentence), file=sys.stderr, flush=True)
