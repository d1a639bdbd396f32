"""The sentences of a page for a thumb, where a terminal names keys."""

import pytest

from capture.tui.touch_wording import name_buttons

LABELS = {
    "f": "Fit",
    "u": "Take back",
    "x": "Export",
    "escape": "Back",
    "esc": "Back",
    "ctrl+s": "Write",
    "^s": "Write",
    "a": "Add",
}


@pytest.mark.parametrize(
    ("sentence", "wanted"),
    [
        ("Press f to fit again, esc to go back.", "Touch Fit to fit again, Back to go back."),
        ("press f to fit", "touch Fit to fit"),
        ("Press f to fit without it, u to have it again.", "Touch Fit to fit without it, Take back to have it again."),  # noqa: E501
        ("The fit runs; esc cancels.", "The fit runs; Back cancels."),
        ("That is all: esc goes back, where u ends it.", "That is all: Back goes back, where Take back ends it."),  # noqa: E501
        ("Name the source, then ^s.", "Name the source, then Write."),
        ("Press esc, then x to export maps.", "Touch Back, then Export to export maps."),
        ("Where pictures come from. → completes it.", "Where pictures come from."),
        ("press ^s again, or esc goes back.", "touch Write again, or Back goes back."),
        ("From 10 views on you may go on (f).", "From 10 views on you may go on (Fit)."),
        ("Press a to add one.", "Touch Add to add one."),
        ("Look at it, and write cover.shape in session.yaml.", "Look at it, and write shape in the Set-up."),  # noqa: E501
        ("source is empty: write one.", "'pictures from' is empty: write one."),
        ("check square_mm, or radius_slope.", "check square (mm), or radius slope."),
        ("The set-up: board.square_mm is 0: write a number.", "square (mm) is 0: write a number."),
        ("The set-up: cover.tilt_deg is 1: write two.", "tilt (degrees) is 1: write two."),
        ("cover.thickness_mm is -1: write a number in millimetres, or unknown.", "thickness (mm) is -1: write a number in millimetres, or touch 'not known'."),  # noqa: E501
        ("1 % is black. Type --crop 0 for a picture with no black border.", "1 % is black."),
        ("Hold a board, a large one, or a to b.", "Hold a board, a large one, or a to b."),
        ("Press n, then put the cover on.", "Press n, then put the cover on."),
        ("The focus is f, as before: expressed in px.", "The focus is f, as before: expressed in px."),  # noqa: E501
    ],
)  # fmt: skip
def test_keys_are_called_by_their_buttons(sentence: str, wanted: str) -> None:
    assert name_buttons(sentence, LABELS) == wanted


def test_without_buttons_nothing_changes() -> None:
    assert name_buttons("Press f to fit.", {}) == "Press f to fit."
