"""Textual's driver in a browser, extended by the data of the page for a thumb; a server names it in
TEXTUAL_DRIVER.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from textual.drivers.web_driver import WebDriver

from capture.tui.phone import PageRequest


class PageDriver(WebDriver):
    muted = False

    def write(self, data: str) -> None:
        if not self.muted:
            super().write(data)

    def on_meta(self, packet_type: str, payload: dict[str, object]) -> None:
        """Handle a message, in the thread that reads."""
        if packet_type == "phone":
            self._app.post_message(PageRequest(json.loads(str(payload["asked"]))))
        else:
            super().on_meta(packet_type, payload)

    def send_content(self, message: dict[str, object]) -> None:
        self.write_meta({"type": "phone", "said": message})

    def offer(self, key: str, files: Sequence[Path]) -> None:
        self.write_meta({"type": "offer", "key": key, "files": [str(file) for file in files]})

    def send_picture(self, jpeg: bytes) -> None:
        self.write_binary_encoded(("jpeg", jpeg))
