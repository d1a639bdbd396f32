"""The straight picture in the terminal, with keys for its depth, crop and scale."""

import time
from types import TracebackType
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from textual import on, work
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.message import Message
from textual.reactive import reactive
from textual.widgets import Footer

from calib.errors import InputError
from capture.narrator import silence_sentence
from capture.streaming.statistics import StreamStatistics
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Ending, Stream
from capture.tui.camera import INTERVAL_S, Preview
from capture.tui.page import Line
from capture.tui.picture import Picture

DEPTH_FACTOR = 1.1
SCALE_FACTOR = 1.25
CROPS = (None, 0.0, 0.25, 0.5, 0.75, 1.0)
"""The crops that the key goes through, in turn."""


class StreamApp(App[Ending]):
    """The window, which is a target of its stream and listens to it."""

    ENABLE_COMMAND_PALETTE = False
    CSS = "Picture { height: 1fr; } Line { height: 1; padding: 0 1; }"
    BINDINGS: ClassVar = [
        Binding("up", "depth(1)", "Farther"),
        Binding("down", "depth(-1)", "Nearer"),
        Binding("c", "crop", "Crop"),
        Binding("plus,equals_sign", "scale(1)", "Larger", key_display="+"),
        Binding("minus", "scale(-1)", "Smaller", key_display="-"),
        Binding("m", "dots", "Dots"),
        Binding("q,ctrl+c", "leave", "Quit", key_display="q", priority=True),
    ]
    dots: reactive[bool] = reactive(False)
    """True if the picture is drawn in dots, for a terminal without greys."""
    on_phone: reactive[bool] = reactive(False)

    class PictureReady(Message):
        def __init__(self, preview: Preview) -> None:
            super().__init__()
            self.preview = preview

    class Remark(Message):
        def __init__(self, sentence: str) -> None:
            super().__init__()
            self.sentence = sentence

    class Counted(Message):
        def __init__(self, line: str) -> None:
            super().__init__()
            self.line = line

    class Ended(Message):
        def __init__(self, ending: Ending) -> None:
            super().__init__()
            self.ending = ending

    def __init__(self) -> None:
        super().__init__()
        self.error: Exception | None = None
        """The error that ended the stream, if one did."""
        self._stream: Stream | None = None
        self._straightener: Straightener | None = None
        self._shown_s = -np.inf
        self._counted_s = -np.inf
        self.set_reactive(StreamApp.dots, self.console.color_system in (None, "standard"))

    def attach(self, stream: Stream, straightener: Straightener) -> None:
        """Set the stream, which begins when the app runs."""
        self._stream = stream
        self._straightener = straightener

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture, as often as a person can see; called in the stream's thread."""
        now_s = time.monotonic()
        if now_s - self._shown_s >= INTERVAL_S:
            self._shown_s = now_s
            self.post_message(self.PictureReady(Preview.of(picture)))

    def tell(self, sentence: str) -> None:
        self.post_message(self.Remark(sentence))

    def report_silence(self, seconds: float) -> None:
        self.post_message(self.Remark(silence_sentence(seconds)))

    def report_counts(self, statistics: StreamStatistics) -> None:
        now_s = time.monotonic()
        if now_s - self._counted_s >= 2 * INTERVAL_S:
            self._counted_s = now_s
            self.post_message(self.Counted(statistics.line()))

    def compose(self) -> ComposeResult:
        yield Picture(id="picture")
        yield Line(id="view")
        yield Line(id="counts")
        yield Line(id="remark")
        yield Footer()

    def on_mount(self) -> None:
        self._show_view()
        self._run_stream()

    @work(thread=True, description="streams")
    def _run_stream(self) -> None:
        assert self._stream
        try:
            self.post_message(self.Ended(self._stream.run()))
        except Exception as error:
            self.error = error
            self.post_message(self.Ended("source"))

    @on(PictureReady)
    def _show_picture(self, message: PictureReady) -> None:
        self.query_one(Picture).show(message.preview, ())
        self._show_view()

    @on(Remark)
    def _show_remark(self, message: Remark) -> None:
        self.query_one("#remark", Line).say(message.sentence)

    @on(Counted)
    def _show_counts(self, message: Counted) -> None:
        self.query_one("#counts", Line).say(message.line)

    @on(Ended)
    def _end(self, message: Ended) -> None:
        self.exit(message.ending)

    def _show_view(self) -> None:
        assert self._straightener
        view = self._straightener.view
        crop = "as the camera" if view.crop is None else f"{view.crop:g}"
        size = "x".join(map(str, self._straightener.size))
        self.query_one("#view", Line).say(
            f"{self._straightener.describe_depth()}, crop {crop}, scale {view.scale:.3g}, {size} px"
        )

    def action_depth(self, steps: int) -> None:
        assert self._straightener
        depth = self._straightener.requested.depth
        if depth is None:
            self.tell("Each pixel has its own depth. --depth gives one to those that have none.")
            return
        self._change({"depth": float(f"{depth * DEPTH_FACTOR**steps:.4g}")})

    def action_crop(self) -> None:
        assert self._straightener
        crop = self._straightener.requested.crop
        following = CROPS.index(crop) + 1 if crop in CROPS else 0
        self._change({"crop": CROPS[following % len(CROPS)]})

    def action_scale(self, steps: int) -> None:
        assert self._straightener
        scale = self._straightener.requested.scale * SCALE_FACTOR**steps
        self._change({"scale": float(f"{scale:.4g}")})

    def action_dots(self) -> None:
        self.dots = not self.dots

    def action_leave(self) -> None:
        """End the stream, which then ends the app."""
        assert self._stream
        self._stream.close()

    def _change(self, values: dict[str, object]) -> None:
        assert self._straightener
        try:
            self._straightener.change(values)
        except InputError as error:
            self.tell(str(error))
