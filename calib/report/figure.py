"""A figure of the page: its data, its title and its caption. The page's scripts draw it."""

from dataclasses import dataclass
from html import escape

from calib.report.payload import Data


@dataclass(frozen=True, slots=True)
class Drawing:
    name: str
    """Unique in the page; the scripts draw the figure by it."""
    title: str
    caption: str
    """Plain text: what the figure shows here."""
    data: Data
    explanation: str = ""
    """Plain text: how to read the figure, which a click shows."""

    def html(self) -> str:
        caption = f"<figcaption>{escape(self.caption)}{self._details()}</figcaption>"
        return f'<figure data-figure="{self.name}"><div class="panels"></div>{caption}</figure>'

    def _details(self) -> str:
        if not self.explanation:
            return ""
        return (
            f"<details><summary>How to read it</summary><p>{escape(self.explanation)}</p></details>"
        )
