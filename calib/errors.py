"""Everything that can go wrong by someone's input, in one tree. The message is one sentence that
says what to do.

Anything else that is raised is a bug, and exits with 1.
"""

import unicodedata

LONGEST = 400
"""Characters of a message; `LEAST_END` of its end stay, for the end says what to do."""
LEAST_END = 150
SHOWN = 80
"""Characters of one text that is not ours, within a message."""


def harmless(foreign: str, most: int | None = None) -> str:
    r"""A text that may be a stranger's, as a terminal may have it: on one line, and without
    anything that it would obey or hide.

    Control characters, line breaks, marks of direction, and bytes that are no UTF-8 are written as
    their escapes, such as \x1b.

    Args:
        most: characters; a longer text is cut there. None: all of it.
    """
    # To cut first is to be quick on a text of megabytes.
    cut = foreign if most is None or len(foreign) <= most else f"{foreign[: most - 3]}..."
    return "".join(c if c.isprintable() else _escaped(c) for c in cut)


def brief(foreign: object) -> str:
    """What a message repeats of a text that is not ours, or of an error that repeats one: harmless,
    and 80 characters at most.
    """
    return harmless(str(foreign), SHOWN)


def _escaped(character: str) -> str:
    if "\udc80" <= character <= "\udcff":  # how Python keeps a byte of a file name
        return f"\\x{ord(character) - 0xDC00:02x}"
    if unicodedata.category(character) == "Zs":  # a space, if an unusual one
        return " "
    return character.encode("unicode_escape").decode()


class RefracalError(Exception):
    """A problem that the person at the keyboard can solve.

    The command prints the sentence and exits with `exit_code`.
    """

    exit_code = 2

    def __init__(self, sentence: str) -> None:
        """What it repeats of files and their names is made harmless here, and a sentence that
        repeats too much is cut in its middle.
        """
        said = (
            harmless(sentence)
            if len(sentence) <= LONGEST
            else harmless(f"{sentence[:LONGEST]}\0{sentence[-LONGEST:]}")
        )
        super().__init__(
            said
            if len(said) <= LONGEST
            else f"{said[: LONGEST - LEAST_END - 3]}...{said[-LEAST_END:]}"
        )


class InputError(RefracalError):
    """Wrong usage or wrong input: a missing file, an unknown key, a truncated image."""


class NotEnoughDataError(RefracalError):
    """The input is well formed, but too little of it is good enough to calibrate from."""

    exit_code = 3


class OtherBoardError(NotEnoughDataError):
    """The pictures show a board, but another than the declared one."""
