"""One app behind a browser window: Textual's own service, which also carries the data of the page
for a thumb.

That page gets the screen as data and the camera's picture as JPEG, in one websocket with the
terminal's text: JSON beside Textual's own, and binary messages that begin with 0xFF, as every JPEG
does and no UTF-8 text can.
"""

import json
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from aiohttp import web
from textual_serve._binary_encode import load
from textual_serve.app_service import AppService
from textual_serve.download_manager import DownloadManager

DRIVER = "capture.tui.page_driver:PageDriver"
PHONE_TERMINAL = (120, 40)
"""Columns and rows of the hidden terminal while a page for a thumb stands in front of it: its
content must not depend on the window, which a phone's keyboard makes small.
"""


class ServedApp(AppService):
    def __init__(
        self,
        command: str,
        websocket: web.WebSocketResponse,
        close: Callable[[], Awaitable[None]],
        downloads: DownloadManager,
        offer: Callable[[str, list[Path]], None],
    ) -> None:
        """`offer` is called with the key of an offer of the app, and with its files."""
        super().__init__(
            command,
            write_bytes=websocket.send_bytes,
            write_str=websocket.send_str,
            close=close,
            download_manager=downloads,
        )
        self._offer = offer
        self._on_phone = False
        self._window = (80, 24)

    def _build_environment(self, width: int = 80, height: int = 24) -> dict[str, str]:
        self._window = width, height
        return super()._build_environment(width, height) | {"TEXTUAL_DRIVER": DRIVER}

    async def set_terminal_size(self, width: int, height: int) -> None:
        """Set the size, and remember it for the time when the terminal is visible again."""
        self._window = width, height
        await super().set_terminal_size(*(PHONE_TERMINAL if self._on_phone else self._window))

    async def forward_request(self, request: Mapping[str, object]) -> None:
        """Forward a request of the page for a thumb."""
        if isinstance(on_phone := request.get("view"), bool):
            self._on_phone = on_phone
            await self.set_terminal_size(*self._window)
            await self.focus()
        await self.send_meta({"type": "phone", "asked": json.dumps(request)})

    async def on_meta(self, data: bytes) -> None:
        message = json.loads(data)
        if message["type"] == "offer":
            self._offer(message["key"], [Path(file) for file in message["files"]])
        elif message["type"] == "phone":
            await self.remote_write_str(json.dumps(["phone", message["said"]]))
        else:
            await super().on_meta(data)

    async def on_packed(self, payload: bytes) -> None:
        match load(payload):
            case ("jpeg", bytes() as jpeg):
                await self.remote_write_bytes(jpeg)
            case _:
                await super().on_packed(payload)
