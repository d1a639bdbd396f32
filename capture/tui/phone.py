"""The app on a page for a thumb: the screen's content goes there as data, the camera's picture as
JPEG, and touches come back as keys.

Nothing is sent, and no picture is encoded, while no such page is open. A picture is sent when the
page has drawn the last but one, so a slow connection gets fewer pictures, and nothing waits for it.
"""

import asyncio
import secrets
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

import cv2
import numpy as np
from numpy.typing import NDArray
from textual.app import App
from textual.events import Key
from textual.message import Message
from textual.widgets import Input, OptionList, Select

from capture.tui.camera import Preview
from capture.tui.cells import LINE_MARK, Mark
from capture.tui.downloads import Download
from capture.tui.mirror import (
    character_of,
    describe_screen,
    find_field,
    screen_id,
    visible_bindings,
)
from capture.tui.picture import Picture

PAUSE_S = 1 / 8  # s between two readings of the screen
QUALITY = 80  # JPEG quality: edges of squares stay clean, at a third of the size that 95 takes
MAX_PENDING = 2  # the maximum number of sent but undrawn pictures
MAX_TEXT = 4096  # the maximum number of characters of a field


class PageRequest(Message):
    """A request of the page."""

    def __init__(self, request: object) -> None:
        """`request` is the request as received."""
        super().__init__()
        self.request = request


class PageConnection(Protocol):
    """The connection to the page."""

    muted: bool
    """True if the terminal's own text is held back."""

    def send_content(self, message: dict[str, object]) -> None: ...

    def send_picture(self, jpeg: bytes) -> None: ...

    def offer(self, key: str, files: Sequence[Path]) -> None:
        """Let the server answer a request for this key with these files."""


class Phone:
    def __init__(
        self,
        app: App[Any],
        connection: PageConnection,
        downloads: Callable[[], Sequence[Download]],
    ) -> None:
        """`downloads` returns the files that the screen in front offers."""
        self._app, self._connection = app, connection
        self._downloads = downloads
        self._last_content: dict[str, object] = {}
        self._pictures: list[tuple[int, int]] = []
        """The widgets whose pictures were sent last, each with the number of its picture."""
        self._offers: dict[Download, str] = {}
        """The key of each offer, which the server knows."""
        self._sent = self._drawn = 0
        """The numbers of sent and of drawn pictures."""

    def handle_request(self, request: object) -> None:
        """Carry out a request of the page.

        A request that is invalid, or meant for a screen that has gone, is ignored.
        """
        screen = self._app.screen
        match request:
            case {"view": bool() as shown}:
                self._view(shown)
            case {"drawn": int() as number}:
                self._drawn = number
            case {"screen": str() as name} if name != screen_id(screen):
                return
            case {"press": str() as key} if key in {
                binding.key for binding in visible_bindings(screen)
            }:
                self._app.post_message(Key(key, character_of(key)))
            case {"field": str() as name, "text": str() as text}:
                if isinstance(field := find_field(screen, name), Input):
                    field.value = "".join(
                        letter for letter in text[:MAX_TEXT] if letter.isprintable()
                    )
            case {"field": str() as name, "choose": int() as place}:
                if field := find_field(screen, name):
                    field.focus()  # so that the help is about this field
                if isinstance(field, Select) and 0 <= place < len(field._options):
                    field.value = field._options[place][1]
                elif isinstance(field, OptionList) and 0 <= place < field.option_count:
                    field.highlighted = place
            case {"field": str() as name, "look": True}:
                if field := find_field(screen, name):
                    field.focus()

    def send_tone(self, tone: str) -> None:
        """Send a tone at once (taken, refused or enough): two may follow each other closely."""
        if self._connection.muted:
            self._connection.send_content({"tone": tone})

    def _view(self, shown: bool) -> None:
        self._connection.muted = shown
        self._last_content, self._pictures, self._sent, self._drawn = {}, [], 0, 0
        self._app.workers.cancel_group(self._app, "phone")
        if shown:
            self._app.run_worker(
                self._follow(), group="phone", description="tells the phone's page"
            )
        else:
            self._app.screen.refresh(layout=True)

    async def _follow(self) -> None:
        while True:
            self._send_content()
            await self._send_picture()
            await asyncio.sleep(PAUSE_S)

    def _send_content(self) -> None:
        content = describe_screen(self._app)
        content["files"] = [
            {"label": item.label, "address": self._address_of(item)} for item in self._downloads()
        ]
        if content != self._last_content:
            self._last_content = content
            self._connection.send_content(content)

    def _address_of(self, download: Download) -> str:
        if download not in self._offers:
            self._offers[download] = secrets.token_urlsafe(16)
            self._connection.offer(self._offers[download], download.files)
        return f"/files/{self._offers[download]}/{quote(download.name)}"

    async def _send_picture(self) -> None:
        screen = self._app.screen
        pictures = list(screen.query(Picture))
        shown = [(id(picture), picture.updates) for picture in pictures]
        if self._sent - self._drawn >= MAX_PENDING or shown == self._pictures:
            return
        self._pictures = shown
        parts = [
            (picture.preview, [*picture.marks, *_name_mark(picture)])
            for picture in pictures
            if picture.preview is not None
        ]
        if not parts:
            return
        image, (width, height), marks = stack_pictures(parts)
        jpeg = await asyncio.to_thread(encode_jpeg, image)
        self._sent += 1
        over = [_mark_data(mark) for mark in marks]
        self._connection.send_content(
            {
                "screen": screen_id(screen),
                "number": self._sent,
                "width": width,
                "height": height,
                "marks": over,
            }
        )
        self._connection.send_picture(jpeg)


def stack_pictures(
    parts: Sequence[tuple[Preview, Sequence[Mark]]],
) -> tuple[NDArray[np.uint8], tuple[int, int], list[Mark]]:
    """Return pictures as one, above one another and equally wide: the image, the width and height
    in px of the widest frame, and the marks there.
    """
    if len(parts) == 1:
        ((preview, marks),) = parts
        return preview.image, preview.size, list(marks)
    image_width = max(preview.image.shape[1] for preview, _ in parts)
    width = max(preview.size[0] for preview, _ in parts)
    images: list[NDArray[np.uint8]] = []
    moved: list[Mark] = []
    top = 0
    for preview, marks in parts:
        height = round(image_width * preview.size[1] / preview.size[0])
        scaled = cv2.resize(preview.image, (image_width, height), interpolation=cv2.INTER_AREA)
        grey = scaled.ndim == 2
        images.append(np.asarray(cv2.cvtColor(scaled, cv2.COLOR_GRAY2BGR) if grey else scaled))
        shift = np.array([0.0, top * width / image_width])
        for mark in marks:
            points = (mark.points + 0.5) * (width / preview.size[0]) - 0.5 + shift
            moved.append(replace(mark, points=points))
        top += height
    return np.concatenate(images), (width, round(top * width / image_width)), moved


def _name_mark(picture: Picture) -> Iterator[Mark]:
    """Yield the label of a picture that has a name."""
    if picture.name and picture.preview:
        width, height = picture.preview.size
        yield Mark(LINE_MARK, np.array([[width / 2, height / 12]]), label=picture.name)


def encode_jpeg(image: np.ndarray) -> bytes:
    """Encode (h, w) or (h, w, 3) BGR as JPEG."""
    done, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    return jpeg.tobytes()


def _mark_data(mark: Mark) -> dict[str, object]:
    visible = np.isfinite(mark.points).all(1)
    return {
        "kind": mark.character,
        "points": np.round(mark.points[visible], 1).tolist(),
        "closed": mark.closed,
        "label": mark.label.strip(),
    }
