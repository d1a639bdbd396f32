"""The app on a page for a thumb: what the screen shows goes there as data, the camera's picture as
JPEG, and touches come back as keys.

Nothing is sent, and no picture encoded, while no such page is there. A picture is sent when the
page has drawn the one before the last, so a slow connection gets fewer of them, and nothing waits
for it.
"""

import asyncio
from typing import Any, Protocol

import cv2
import numpy as np
from textual.app import App
from textual.events import Key
from textual.message import Message
from textual.widgets import Input, OptionList, Select

from capture.tui.cells import Mark
from capture.tui.mirror import character_of, described, handle, keys, named
from capture.tui.picture import Picture

PAUSE_S = 1 / 8  # between two looks at the screen
QUALITY = 80  # of the JPEG: edges of squares stay clean, at a third of what 95 takes
AHEAD = 2  # pictures on their way, at most
LONGEST = 4096  # characters of a field


class Asked(Message):
    """The page wants something."""

    def __init__(self, what: object) -> None:
        """`what`: as it came."""
        super().__init__()
        self.what = what


class Line(Protocol):
    """To the page."""

    muted: bool
    """Whether the terminal's own text is kept back."""

    def tell(self, said: dict[str, object]) -> None: ...

    def show(self, jpeg: bytes) -> None: ...


class Phone:
    def __init__(self, app: App[Any], line: Line) -> None:
        self._app, self._line = app, line
        self._told: dict[str, object] = {}
        self._picture: tuple[int, int] = (0, -1)
        """Which widget's picture was sent last, and which of its pictures."""
        self._sent = self._drawn = 0
        """Pictures."""

    def obey(self, what: object) -> None:
        """Do what the page asks.

        What makes no sense, or is of a screen that has gone, is passed over.
        """
        screen = self._app.screen
        match what:
            case {"view": bool() as shown}:
                self._view(shown)
            case {"drawn": int() as number}:
                self._drawn = number
            case {"screen": str() as name} if name != handle(screen):
                return
            case {"press": str() as key} if key in {binding.key for binding in keys(screen)}:
                self._app.post_message(Key(key, character_of(key)))
            case {"field": str() as name, "text": str() as text}:
                if isinstance(field := named(screen, name), Input):
                    field.value = "".join(
                        letter for letter in text[:LONGEST] if letter.isprintable()
                    )
            case {"field": str() as name, "choose": int() as place}:
                field = named(screen, name)
                if isinstance(field, Select) and 0 <= place < len(field._options):
                    field.value = field._options[place][1]
                elif isinstance(field, OptionList) and 0 <= place < field.option_count:
                    field.highlighted = place
            case {"field": str() as name, "look": True}:
                if field := named(screen, name):
                    field.focus()

    def hear(self, tone: str) -> None:
        """Taken, refused or enough: at once, for two may follow each other closely."""
        if self._line.muted:
            self._line.tell({"tone": tone})

    def _view(self, shown: bool) -> None:
        self._line.muted = shown
        self._told, self._picture, self._sent, self._drawn = {}, (0, -1), 0, 0
        self._app.workers.cancel_group(self._app, "phone")
        if shown:
            self._app.run_worker(
                self._follow(), group="phone", description="tells the phone's page"
            )
        else:
            self._app.screen.refresh(layout=True)

    async def _follow(self) -> None:
        while True:
            self._tell()
            await self._show()
            await asyncio.sleep(PAUSE_S)

    def _tell(self) -> None:
        now = described(self._app)
        if now != self._told:
            self._told = now
            self._line.tell(now)

    async def _show(self) -> None:
        screen = self._app.screen
        picture = next(iter(screen.query(Picture)), None)
        if (
            picture is None
            or self._sent - self._drawn >= AHEAD
            or (shown := (id(picture), picture.updates)) == self._picture
        ):
            return
        self._picture = shown
        preview, marks = picture.preview, picture.marks
        if preview is None:
            return
        jpeg = await asyncio.to_thread(encoded, preview.image)
        self._sent += 1
        width, height = preview.size
        over = [_drawn(mark) for mark in marks]
        self._line.tell(
            {
                "screen": handle(screen),
                "number": self._sent,
                "width": width,
                "height": height,
                "marks": over,
            }
        )
        self._line.show(jpeg)


def encoded(image: np.ndarray) -> bytes:
    """(h, w) or (h, w, 3) BGR as JPEG."""
    done, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    return jpeg.tobytes()


def _drawn(mark: Mark) -> dict[str, object]:
    seen = np.isfinite(mark.points).all(1)
    return {
        "kind": mark.character,
        "points": np.round(mark.points[seen], 1).tolist(),
        "closed": mark.closed,
        "label": mark.label.strip(),
    }
