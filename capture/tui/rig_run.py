"""The cameras' threads behind the screen of a rig: moments in, previews and steps out.

It touches no widget.
"""

from collections.abc import Callable, Iterator, Sequence

from capture.finders import make_finder
from capture.frames import Frame
from capture.recording_loop import RecordingPlan, ShutterButton
from capture.rig.moment_gate import Corners
from capture.rig.rig_guide import RigGuide
from capture.rig.rig_loop import RigStep, detect_in_rig, record_moments
from capture.rig.rig_reader import RigReader
from capture.rig.rig_recorder import RigRecorder
from capture.rig.rig_setup import RigSetup
from capture.rig.rig_sources import open_sources
from capture.tui.camera import INTERVAL_S, Preview


class RigRun:
    """One run of recording. `close` ends it from any thread, also before it has started."""

    def __init__(
        self,
        setup: RigSetup,
        shutter: ShutterButton,
        show: Callable[[str, Preview], object],
        on_silence: Callable[[str, float], object],
        sharp: Callable[[], bool] = lambda: False,
    ) -> None:
        """`show` gets the frames of each camera, in the phone's size if `sharp` says so at that
        moment; `on_silence` gets the camera and the seconds without a frame. Each is called from
        its own thread.
        """
        self.remarks: Sequence[str] = ()
        """Sentences that a person should know about this recording."""
        self.guide: RigGuide | None = None
        """The guide; None before the first moment."""
        self.closed = False
        self._setup = setup
        self._shutter = shutter
        self._show = show
        self._sharp = sharp
        self._last_s: dict[str, float] = {}
        self._reader = RigReader(open_sources(setup.sources), on_silence, self._preview)

    def run(self, on_start: Callable[[Sequence[Corners]], object]) -> Iterator[RigStep]:
        """Yield every judged moment, until the sources end. `on_start` gets the corners of the
        views that the rig has already.

        RefracalError: a camera, the disk or the set-up prevents the recording.
        """
        setup = self._setup
        with (
            self._reader as reader,
            RigRecorder(
                setup.rig,
                setup.board,
                likes=setup.likes,
                shutters={name: source.shutter for name, source in reader.sources.items()},
            ) as recorder,
        ):
            finders = {name: make_finder(setup.board) for name in reader.sources}
            views = detect_in_rig(recorder, finders)
            on_start(tuple(views))
            plan = RecordingPlan(views=None)
            for step in record_moments(
                reader, finders, setup.board, recorder, plan, views, self._shutter
            ):
                if self.guide is None:
                    sizes = {name: frame.size for name, frame in step.moment.frames.items()}
                    self.guide = RigGuide(setup.board, recorder.cameras(sizes))
                self.remarks = [
                    *(f"{name}: {r}" for name, s in reader.sources.items() for r in s.remarks),
                    *recorder.remarks,
                ]
                if not reader.live:
                    for name, frame in step.moment.frames.items():
                        self._show(name, Preview.of(frame.pixels, sharp=self._sharp()))
                yield step

    def close(self) -> None:
        self.closed = True
        self._reader.close()

    def _preview(self, name: str, frame: Frame) -> None:
        if frame.time_s - self._last_s.get(name, -1.0) >= INTERVAL_S:
            self._last_s[name] = frame.time_s
            self._show(name, Preview.of(frame.pixels, sharp=self._sharp()))
