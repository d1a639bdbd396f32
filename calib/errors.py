"""Errors that a user can cause and solve. The message is one sentence that says what to do.

Any other exception is a bug, and a command that raises one exits with 1.
"""

import unicodedata
from collections.abc import Sequence
from difflib import get_close_matches

MAX_MESSAGE = 400
"""Characters of a message. At least `MIN_ENDING` of its end are kept: the end says what to do."""
MIN_ENDING = 150
MAX_FOREIGN = 80
"""Characters of foreign text within a message."""
CLOSE = 0.65
"""How alike a word and the choice that it may mean are, at the least: 1 is the same."""
SYNONYMS = {
    **dict.fromkeys(("window", "port", "plane", "pane"), "flat"),
    **dict.fromkeys(("sphere", "hemisphere"), "dome"),
    **dict.fromkeys(("tube", "pipe"), "cylinder"),
    **dict.fromkeys(("show", "view", "open"), "report"),
    **dict.fromkeys(("calibrate", "calib"), "fit"),
    **dict.fromkeys(("rectify", "straighten", "dewarp"), "undistort"),
    **dict.fromkeys(("test", "validate"), "evaluate"),
    **dict.fromkeys(("new", "create"), "init"),
}
"""Other words for shapes and commands."""


def harmless(foreign: str, max_length: int | None = None) -> str:
    r"""Return foreign text in a form that is safe to print in a terminal, on one line.

    Control characters, line breaks, direction marks and bytes that are not UTF-8 become escapes,
    such as \x1b.

    Args:
        most: the number of characters at which the text is cut. None: no limit.
    """
    # Cutting first keeps this quick on megabytes of text.
    cut = (
        foreign
        if max_length is None or len(foreign) <= max_length
        else f"{foreign[: max_length - 3]}..."
    )
    return "".join(c if c.isprintable() else _escaped(c) for c in cut)


def brief(foreign: object) -> str:
    """Return a harmless quotation of foreign text, or of an error that contains some, of at most 80
    characters.
    """
    return harmless(str(foreign), MAX_FOREIGN)


def _escaped(character: str) -> str:
    if "\udc80" <= character <= "\udcff":  # a byte of a file name, in Python's encoding
        return f"\\x{ord(character) - 0xDC00:02x}"
    if unicodedata.category(character) == "Zs":  # an unusual space
        return " "
    return character.encode("unicode_escape").decode()


def meant(foreign: object, choices: Sequence[str]) -> str:
    """Return the choice that a word, in small letters or capitals, may have been meant as; "" if
    none is close.
    """
    word = brief(foreign).lower()
    if SYNONYMS.get(word) in choices:
        return SYNONYMS[word]
    spellings = {choice.lower(): choice for choice in choices}
    return "".join(spellings[close] for close in get_close_matches(word, spellings, 1, CLOSE))


class RefracalError(Exception):
    """A problem that the user can solve.

    The command prints the sentence and exits with `exit_code`.
    """

    exit_code = 2

    def __init__(self, sentence: str) -> None:
        """Make the sentence harmless, and cut one that is too long in its middle."""
        message = (
            harmless(sentence)
            if len(sentence) <= MAX_MESSAGE
            else harmless(f"{sentence[:MAX_MESSAGE]}\0{sentence[-MAX_MESSAGE:]}")
        )
        super().__init__(
            message
            if len(message) <= MAX_MESSAGE
            else f"{message[: MAX_MESSAGE - MIN_ENDING - 3]}...{message[-MIN_ENDING:]}"
        )


class InputError(RefracalError):
    """Wrong usage or wrong input: a missing file, an unknown key, a truncated image."""


class WrongTypeError(InputError, TypeError):
    """An argument of a call of the library is of a type that the call does not take."""


class NotEnoughDataError(RefracalError):
    """The input is well formed, but too little of it is good enough to calibrate from."""

    exit_code = 3


class OtherBoardError(NotEnoughDataError):
    """The pictures show a board that differs from the declared one."""


def wrong_type(name: str, value: object, advice: str) -> WrongTypeError:
    """Return the error that an argument has the wrong type. `advice` says what to pass."""
    return WrongTypeError(f"{name} is of type {type(value).__name__}: pass {advice}.")
