"""The help, for someone who has never calibrated a camera."""

import re
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.widgets import Footer, Static

from capture.tui.sized import Dialog, SizeNotice

TEXT = """\
A camera behind a cover (a cone, a dome, a window) sees everything a little
bent. From pictures of a checkerboard, Refracal finds out how, and writes maps
that straighten pictures at any depth.

1 Set-up         Name the camera; describe the board and the cover.
2 Without cover  Take the cover off and record the board: this finds the lens.
3 Through cover  Put it on, leave the focus alone, and record the board again.
4 Fit            Takes seconds to minutes. The error should fall: first as if
                 there were no cover, then with smooth, ideal glass as it is
                 declared, then with uneven glass like yours.
5 Results        Drop views that are spoiled; diagnose what the model lacks;
                 export maps; later, check that they still hold.

The large line below the picture says what to do now. Pictures are taken by
themselves, with a bell, once the board is whole, still, sharp and somewhere
new; space takes one at once. A frame of ▒ shows where to hold the board next,
and the words below say how to tilt it. + marks what was found of the board.
The small maps (picture, glass that rays cross, depths) fill up to █, enough.
Good views: all over the picture, near and far, tilted to all four sides.

A number that is not known well: 25 ± 10 or 25 +- 10. The fit finds it.
The last line has every key; on a phone, tap it there. m: pictures in dots.
"""

DRAWN = {
    "A frame of ▒": "A yellow frame",
    "+ marks": "Green dots mark",
    "space takes": "Take now takes",
    "fill up to █, enough.": "turn green where there is enough.",
    "The last line has every key; on a phone, tap it there. m: pictures in dots.": (
        "Auto off: a picture is taken by Take now alone. Undo takes back a dropped view."
    ),
}
"""The replacements for a page that draws the app for a thumb, which has no characters as marks."""


class Prose(Static):
    """A text whose lines end where those of a terminal do."""

    @property
    def flowing(self) -> str:
        """The text for a page that draws it: in lines as long as its paragraphs."""
        text = str(self.content)
        for phrase, replacement in DRAWN.items():
            text = text.replace(phrase, replacement)
        joined = re.sub(r"(?<=\S)\n(?! *\n)(?!\d )\s*", " ", text)
        return re.sub(r"(?<=\S) {2,}", ": ", joined)


class HelpScreen(Dialog[None]):
    DEFAULT_CSS = (
        "HelpScreen { background: $background; } HelpScreen VerticalScroll { height: 1fr; padding:"
        " 0 1; }"
    )
    BINDINGS: ClassVar = [
        Binding("escape,question_mark,q", "dismiss", "Back", key_display="esc"),
        Binding("up,down", "scroll", "More", key_display="↑↓"),
    ]

    def compose(self) -> ComposeResult:
        with VerticalScroll():
            yield Prose(TEXT, markup=False)
        yield SizeNotice()
        yield Footer(show_command_palette=False, compact=True)
