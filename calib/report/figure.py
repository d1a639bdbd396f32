"""A figure of the page with its title and caption."""

from dataclasses import dataclass
from html import escape


@dataclass(frozen=True, slots=True)
class Drawing:
    name: str
    """Unique in the page; the ids in the SVG begin with it."""
    title: str
    svg: str
    caption: str
    """Plain text."""

    def html(self) -> str:
        caption = f"<figcaption>{escape(self.caption)}</figcaption>"
        return f'<figure><div class="wide">{self.svg}</div>{caption}</figure>'
