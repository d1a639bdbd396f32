"""The output of a rig's recording without a screen: kept pictures on stdout; instructions and
remarks on stderr.
"""

import sys
from pathlib import Path

import numpy as np

from calib.errors import harmless
from calib.io.numerals import counted
from capture.narrator import SilenceRemarks
from capture.rig.rig_guide import RigHint, RigProgress
from capture.rig.rig_loop import RigStep
from capture.rig.rig_reader import RigReader
from capture.rig.rig_recorder import RigRecorder


class RigNarrator:
    def __init__(
        self, reader: RigReader, recorder: RigRecorder, views: int | None, *, json: bool
    ) -> None:
        """`views` is the wanted number of shared views, None for all; with `json`, stdout carries
        only the summary.
        """
        self.sentence = ""
        """The instruction for the person."""
        self.judged = 0
        """The number of judged moments."""
        self.views = 0
        """The number of views that several cameras share."""
        self.singles = 0
        """The number of views of one camera alone."""
        self._pictures: dict[str, list[Path]] = {name: [] for name in reader.sources}
        self._offsets: dict[str, list[float]] = {name: [] for name in reader.sources}
        self._reader = reader
        self._recorder = recorder
        self._wanted = views
        self._json = json
        self._reported: set[str] = set()
        for name, source in reader.sources.items():
            for remark in source.remarks:
                _remark(f"{name}: {remark}")

    def report_step(self, step: RigStep) -> None:
        """Print the pictures if some were kept; else the decision if it differs from the last."""
        self.judged += 1
        reference = next(iter(step.moment.frames.values())).time_s
        for name, frame in step.moment.frames.items():
            self._offsets[name].append(frame.time_s - reference)
        if step.pictures:
            self.views, self.singles = step.views, step.singles
            for name, picture in step.pictures.items():
                self._pictures[name].append(picture)
            self._print_pictures(step)
        elif step.decision.sentence != self.sentence or step.moment.isolated:
            name = next(iter(step.moment.frames.values())).name
            is_photograph = step.moment.isolated and name
            _remark(
                f"{name}: {step.decision.sentence}" if is_photograph else step.decision.sentence
            )
        self.sentence = step.decision.sentence

    def report_advice(self, hint: RigHint | None, progress: RigProgress) -> None:
        _remark(progress.sentence)
        if hint:
            _remark(f"Next, {hint.instruction}.")

    def print_summary(self) -> None:
        print(harmless(f"{self._summary()} in {self._recorder.rig.path}."))
        if offsets := self._describe_offsets():
            print(harmless(f"{offsets}."))
        if self.views:
            print(harmless(f"Next: {self._recorder.rig.fit_command}"))

    def report_safety(self) -> None:
        """Say, before an error is printed, that the pictures so far are safe."""
        if any(self._pictures.values()):
            _remark(f"Safe in {self._recorder.rig.path}: {self._summary()}.")

    @property
    def has_pictures(self) -> bool:
        return any(self._pictures.values())

    def as_json(self, *, ended: str) -> dict[str, object]:
        tolerance = self._reader.pairing.tolerance_s
        cameras = {
            name: {
                "session": str(self._recorder.rig.sessions[name]),
                "pictures": [picture.name for picture in pictures],
                "frames_lost": self._reader.frames_lost[name],
                "offset_ms": self._offset_ms(name),
            }
            for name, pictures in self._pictures.items()
        }
        return {
            "rig": str(self._recorder.rig.path),
            "cameras": cameras,
            "views": self.views,
            "views_alone": self.singles,
            "moments_judged": self.judged,
            "moments_passed_over": self._reader.skipped,
            "frames_unpaired": self._reader.pairing.unpaired,
            "tolerance_ms": None if tolerance is None else round(1000 * tolerance, 3),
            "remarks": list(self._recorder.remarks),
            "next": self._recorder.rig.fit_command if self.views else None,
            "ended": ended,
        }

    def _print_pictures(self, step: RigStep) -> None:
        if not self._json:
            together = f"view {self.views}" + (f" of {self._wanted}" if self._wanted else "")
            of = together if len(step.pictures) > 1 else "alone"
            places = "  ".join(str(picture) for picture in step.pictures.values())
            print(harmless(f"{places}  {of}"), flush=True)
        for remark in self._recorder.remarks:
            if remark not in self._reported:
                self._reported.add(remark)
                _remark(remark)

    def _offset_ms(self, name: str) -> float | None:
        """Return the median time of a camera's frames after those of the first camera."""
        offsets = self._offsets[name]
        return round(1000 * float(np.median(offsets)), 3) if offsets else None

    def _describe_offsets(self) -> str:
        """Return how far apart the cameras' pictures are in time; empty for pictures without
        times.
        """
        tolerance = self._reader.pairing.tolerance_s
        if tolerance is None or not self.judged:
            return ""
        reference, *further = self._pictures
        parts = []
        for name in further:
            offset = self._offset_ms(name) or 0.0
            order = "after" if offset >= 0 else "before"
            parts.append(f"{name} is {abs(offset):.1f} ms {order} {reference}")
        return (
            f"{', '.join(parts)} (median); pictures up to {1000 * tolerance:.1f} ms apart belong"
            " together"
        )

    def _summary(self) -> str:
        reader = self._reader
        lost = sum(reader.frames_lost.values())
        skipped = f", {reader.skipped} passed over meanwhile" if reader.skipped else ""
        unpaired = reader.pairing.unpaired
        without = f", {counted(unpaired, 'frame')} without partner" if unpaired else ""
        lost_frames = f", {lost} lost by the cameras" if lost else ""
        alone = f" and {counted(self.singles, 'view')} of one camera alone" if self.singles else ""
        return (
            f"{counted(self.views, 'shared view')}{alone} ({counted(self.judged, 'moment')}"
            f" judged{skipped}{without}{lost_frames})"
        )


class RigSilenceRemarks:
    """Remarks that a camera sends no picture, as `SilenceRemarks` says it of a single one."""

    def __init__(self) -> None:
        self._remarks: dict[str, SilenceRemarks] = {}

    def __call__(self, name: str, seconds: float) -> None:
        self._remarks.setdefault(name, SilenceRemarks(f"{name}: "))(seconds)


def _remark(sentence: str) -> None:
    print(harmless(sentence), file=sys.stderr, flush=True)
