"""What a recording without a screen says: kept pictures on stdout, what to do next and remarks on
stderr.
"""

import sys
from pathlib import Path

from calib.errors import harmless
from capture.reader import Reader
from capture.recorder import Recorder
from capture.recording_loop import Step


class Narrator:
    def __init__(
        self, reader: Reader, recorder: Recorder, views: int | None, *, json: bool
    ) -> None:
        """`views` is how many are wanted, None where there is no such number; with `json`, stdout
        is left to the summary.
        """
        self.sentence = ""
        """What to do now."""
        self.judged = 0
        """Frames that were looked at."""
        self.views = 0
        self.pictures: list[Path] = []
        self._reader = reader
        self._recorder = recorder
        self._wanted = views
        self._json = json
        self._said = 0
        for remark in reader.source.remarks:
            _remark(remark)

    def tell(self, step: Step) -> None:
        """The picture, if it was kept; else the verdict, of a photograph by its name, of a stream
        if it is another than before.
        """
        self.judged += 1
        if step.picture:
            self.kept(step.picture, step.view)
        elif step.frame.alone:
            _remark(f"{step.frame.name}: {step.verdict.sentence}")
        elif step.verdict.sentence != self.sentence:
            _remark(step.verdict.sentence)
        self.sentence = step.verdict.sentence

    def kept(self, picture: Path, view: int) -> None:
        self.pictures.append(picture)
        self.views = view
        if not self._json:
            of = f" of {self._wanted}" if self._wanted else ""
            print(harmless(f"{picture}  view {view}{of}"), flush=True)
        for remark in self._recorder.remarks[self._said :]:
            _remark(remark)
        self._said = len(self._recorder.remarks)

    def sum_up(self) -> None:
        print(harmless(f"{self._sum()} in {self._recorder.session}."))

    def reassure(self) -> None:
        """Before an error is told: what there is already is safe."""
        if self.pictures:
            _remark(f"Safe in {self._recorder.session}: {self._sum()}.")

    def as_json(self, *, ended: str) -> dict[str, object]:
        return {
            "session": str(self._recorder.session),
            "pictures": [
                str(picture.relative_to(self._recorder.session)) for picture in self.pictures
            ],
            "views": self.views,
            "frames_judged": self.judged,
            "frames_passed_over": self._reader.unseen,
            "frames_lost": self._reader.lost,
            "remarks": [*self._reader.source.remarks, *self._recorder.remarks],
            "ended": ended,
        }

    def _sum(self) -> str:
        taken = f"{_count(self.judged or len(self.pictures), 'frame')} taken"
        passed = f", {self._reader.unseen} passed over meanwhile" if self._reader.unseen else ""
        lost = f", {self._reader.lost} lost by the camera" if self._reader.lost else ""
        return (
            f"{_count(self.views, 'view')} with {_count(len(self.pictures), 'picture')}"
            f" ({taken}{passed}{lost})"
        )


class Waits:
    """Says that no picture comes: at the first silence, and then at each that is twice as long as
    those before.
    """

    def __init__(self) -> None:
        self._longest = 0.0

    def __call__(self, seconds: float) -> None:
        if seconds >= 2 * self._longest:
            self._longest = seconds
            _remark(waiting(seconds))


def waiting(seconds: float) -> str:
    return f"No picture has come for {seconds:.0f} s: waiting for the next one."


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'s' * (number != 1)}"


def _remark(sentence: str) -> None:
    print(harmless(sentence), file=sys.stderr, flush=True)
