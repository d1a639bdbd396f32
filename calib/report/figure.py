"""A figure of the page: its drawing, what it shows, and how to read it."""

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
        return (
            "<figure><div"
            f' class="wide">{self.svg}</div><figcaption>{escape(self.caption)}</figcaption></figure>'  # noqa: E501
        )
