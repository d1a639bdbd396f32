"""Textual's driver in a browser, which also carries what the page for a thumb needs; a server names
it in TEXTUAL_DRIVER.
"""

import json

from textual.drivers.web_driver import WebDriver

from capture.tui.phone import Asked


class PageDriver(WebDriver):
    muted = False

    def write(self, data: str) -> None:
        if not self.muted:
            super().write(data)

    def on_meta(self, packet_type: str, payload: dict[str, object]) -> None:
        """In the thread that reads."""
        if packet_type == "phone":
            self._app.post_message(Asked(json.loads(str(payload["asked"]))))
        else:
            super().on_meta(packet_type, payload)

    def tell(self, said: dict[str, object]) -> None:
        self.write_meta({"type": "phone", "said": said})

    def show(self, jpeg: bytes) -> None:
        self.write_binary_encoded(("jpeg", jpeg))
