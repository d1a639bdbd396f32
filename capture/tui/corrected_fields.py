"""The fields of the set-up that correct what a verdict or a failed fit doubts.

Pure.
"""

import re
from collections.abc import Iterable, Iterator

from calib.session.parameter_names import CAMERA, number_of
from calib.session.shapes.registry import find_shape
from capture.tui.form import BOARD

LABELS = {
    "kind": "board type",
    "type": "board type",
    "shape": "cover shape",
    "like": "like (optional)",
}
"""The labels of fields that are not called by their keys."""
KEY = re.compile(r"\b(?:board|cover)\.([a-z_]+)")
"""Matches a key of session.yaml that the form has, as sentences name it."""
BOARD_KEYS = {key for keys in BOARD.values() for key in keys}
WHOLE_BOARD = re.compile(r"\bboard in session\.yaml\b")
"""Matches the words of a sentence that doubts the board and no single key."""
FILE = re.compile(r"\b(in|correct) session\.yaml\b")
"""Matches the words of a sentence that send a person to the file."""
COMMAND = re.compile(r",? or call calib fit with --board [0-9]+x[0-9]+")
"""Matches the command that a sentence proposes beside the keys."""

FIT_ANEW = "Then press ^r to fit again."
RECORD_ANEW = "Then press ^s to record."
"""The sentences on how to go on from a corrected field."""


def label_of(field: str) -> str:
    """Return the label of a field, by its name."""
    return LABELS.get(field, field)


def list_labels(fields: Iterable[str]) -> str:
    """Return the labels of one field or more, such as "columns, rows or square_mm"."""
    *first_labels, last = map(label_of, fields)
    return f"{', '.join(first_labels)} or {last}" if first_labels else last


def suspected_fields(suspects: Iterable[str], shape: str, *, has_lens: bool) -> tuple[str, ...]:
    """Return the names of the fields that correct suspected numbers, each once.

    Args:
        suspects: the names of numbers as a verdict has them, such as cover.inner_radius. Those that
            the form does not have, such as an effect's, are left out.
        shape: the shape of the cover.
        has_lens: true if session.yaml declares the lens, which another session replaces.
    """
    fields = (
        field
        for suspect in suspects
        for field in _fields_of(suspect, shape)
        if field != "like" or has_lens
    )
    return tuple(dict.fromkeys(fields))


def _fields_of(suspect: str, shape: str) -> Iterator[str]:
    if CAMERA.has(suspect):
        yield "like"
        return
    part, _, key = suspect.partition(".")
    if part == "board" and key in BOARD_KEYS:
        yield key
    elif part == "cover" and key == "shape":
        yield "shape"
    elif part == "cover":
        number = number_of(suspect)
        for dimension in find_shape(shape).keys:
            if number in dimension.quantity.names:
                yield dimension.quantity.key


def named_fields(sentence: str) -> tuple[str, ...]:
    """Return the names of the fields whose keys a sentence has, each once."""
    kind = ["kind"] if WHOLE_BOARD.search(sentence) else []
    return tuple(dict.fromkeys([*KEY.findall(sentence), *kind]))


def in_form_words(sentence: str) -> str:
    """Return a sentence about session.yaml in the words of the form."""
    words = FILE.sub(r"\1 the set-up", COMMAND.sub("", sentence))
    return KEY.sub(lambda key: label_of(key[1]), words)
