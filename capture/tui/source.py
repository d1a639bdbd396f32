"""The field that names where pictures come from, and below it the cameras that this machine has."""

from asyncio import to_thread
from collections.abc import Sequence

from textual import on, work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.message import Message
from textual.suggester import SuggestFromList
from textual.widgets import Static

from calib.errors import InputError, harmless
from capture.sources.registry import SCHEMES, open_source
from capture.tui.page import Field
from capture.tui.references import cannot_be_opened, played
from capture.tui.row import Row


class Source(Vertical):
    DEFAULT_CSS = """
    Source { height: auto; }
    Source #cameras { margin: 0 0 0 19; }
    """

    class Found(Message):
        """The cameras of this machine."""

        def __init__(self, sources: Sequence[str]) -> None:
            super().__init__()
            self.sources = sources

    def __init__(self, source: str) -> None:
        super().__init__()
        self.field = Field(source, id="source", compact=True)
        self._shut = ("", "")
        """The source that could not be opened last, and why."""

    def compose(self) -> ComposeResult:
        yield Row("source", self.field)
        yield Static("", id="cameras", markup=False)

    def on_mount(self) -> None:
        self._find_cameras()

    @work(thread=True, exclusive=True, group="cameras")
    def _find_cameras(self) -> None:
        found = [
            camera
            for scheme in SCHEMES
            for camera in scheme.backend().inventory().cameras
            if not camera.problem
        ]
        self.post_message(self.Found([camera.source for camera in found]))

    @on(Found)
    def _offer(self, message: Found) -> None:
        self.field.suggester = SuggestFromList(message.sources)
        words = (
            f"found here: {', '.join(message.sources)}"
            if message.sources
            else "no camera found here; folder:PATH plays back pictures"
        )
        self.query_one("#cameras", Static).update(harmless(words))
        if message.sources and not self.field.value:
            self.field.value = message.sources[0]

    def check(self) -> None:
        """InputError where it names nothing, or what could not be opened last."""
        open_source(self.field.value, "source")
        if self.field.value == self._shut[0]:
            raise InputError(self._shut[1])

    async def opens(self, source: str) -> bool:
        """Whether these pictures, which the field stands for, can be opened; of a camera it is not
        asked.
        """
        if played(source) and (shut := await to_thread(cannot_be_opened, source)):
            self._shut = self.field.value, shut
            return False
        return True
