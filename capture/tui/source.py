"""The field for the source of pictures, and below it the cameras of this machine."""

from asyncio import to_thread
from collections.abc import Sequence

from textual import on, work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.message import Message
from textual.widgets import Static

from calib.errors import InputError, harmless
from capture.sources.registry import is_recorded_source, open_source, usable_cameras
from capture.tui.page import Field
from capture.tui.path_suggester import PathSuggester
from capture.tui.references import explain_unreadable
from capture.tui.row import NEEDED, Row


class SourceField(Vertical):
    DEFAULT_CSS = """
    SourceField { height: auto; }
    SourceField #cameras { margin: 0 0 0 19; }
    """

    class CamerasFound(Message):
        """The cameras of this machine were found."""

        def __init__(self, sources: Sequence[str]) -> None:
            super().__init__()
            self.sources = sources

    def __init__(self, source: str) -> None:
        super().__init__()
        self.field = Field(
            source,
            id="source",
            placeholder=NEEDED,
            suggester=PathSuggester(kinds=True),
            compact=True,
        )
        self._failure = ("", "")
        """The source that could not be opened last, and the reason."""
        self._cameras: tuple[str, ...] | None = None
        """The cameras of this machine; None while it is searched."""

    def compose(self) -> ComposeResult:
        yield Row("source", self.field)
        yield Static("", id="cameras", markup=False)

    def on_mount(self) -> None:
        self._find_cameras()

    @work(thread=True, exclusive=True, group="cameras")
    def _find_cameras(self) -> None:
        self.post_message(self.CamerasFound(usable_cameras()))

    @on(CamerasFound)
    def _offer(self, message: CamerasFound) -> None:
        self._cameras = tuple(message.sources)
        self.field.suggester = PathSuggester(kinds=True, cameras=message.sources)
        if message.sources and not self.field.value:
            self.field.value = message.sources[0]
        self._describe()

    @on(Field.Changed)
    def _describe(self) -> None:
        """Write the cameras below the field. Whoever plays back pictures needs none."""
        if self._cameras:
            words = f"found here: {', '.join(self._cameras)}"
        elif self._cameras is None or is_recorded_source(self.field.value):
            words = ""
        else:
            words = "no camera found here; folder:PATH plays back pictures"
        self.query_one("#cameras", Static).update(harmless(words))

    def check(self) -> None:
        """Raise InputError where the field names no source, or one that could not be opened
        last.
        """
        open_source(self.field.value, "source")
        if self.field.value == self._failure[0]:
            raise InputError(self._failure[1])

    async def can_open(self, source: str) -> bool:
        """Return True if the pictures of this source can be opened; a camera is not tried."""
        if is_recorded_source(source) and (reason := await to_thread(explain_unreadable, source)):
            self._failure = self.field.value, reason
            return False
        return True
