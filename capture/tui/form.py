"""The set-up as a person types it: texts in, checked by the session's own rules, a set-up out. Pure."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from calib.errors import InputError
from calib.session.board import Board
from calib.session.camera import Camera, camera_to_yaml
from calib.session.cover import SHAPES, Cover, cover_to_yaml
from calib.session.schema import Quantity, Section
from calib.session.session import session_from_mapping, session_to_yaml
from capture.session_file import Setup

BOARD = ("columns", "rows", "square_mm")
WHERE = "The set-up"

HELP = {
    "columns": "The board's inner corners along one row: one less than its squares.",
    "rows": "The board's inner corners along one column: one less than its squares.",
    "square_mm": "The side of one square in millimetres. Measure over many squares and divide.",
    "shape": "The cover in front of the camera. none: there is none, only the lens is calibrated.",
    "inner_radius_mm": "Millimetres from the cover's axis to its inner face, at the height of the lens.",
    "radius_slope": "By how much the radius grows downwards: -0.1 is 1 mm narrower every 10 mm.",
    "axis_offset_mm": "From the lens to the cover's axis in mm: x to the right in the picture, z ahead; 0, -30 is 30 mm behind.",
    "tilt_deg": "Degrees by which the cover is tilted, about two axes: 0, 0 if it is mounted straight.",
    "thickness_mm": "Thickness of the glass in millimetres.",
    "refractive_index": "Of the glass: about 1.5; acrylic 1.49, polycarbonate 1.58.",
    "outside_index": "Of what is outside: 1 in air, 1.333 in water.",
    "distance_mm": "Millimetres from the lens to the window's inner face.",
    "centre_mm": "x, y, z in mm from the lens to the dome's centre.",
}
"""What each value is, for someone who has never seen a session.yaml. Its rule is said when it is broken."""


@dataclass(frozen=True, slots=True)
class Typed:
    """Every text of the form, by the keys of session.yaml."""

    board: Mapping[str, str]
    shape: str
    cover: Mapping[str, str]


def problem(key: str, text: str, shape: str) -> str | None:
    """What is wrong with one value by itself, or None."""
    try:
        if key in BOARD:
            section = Section({key: _number(text)}, WHERE, "board")
            session_from_mapping(_mapping({"columns": 3, "rows": 3, "square_mm": 1, **section.values}, {"shape": "none"}), WHERE)
        else:
            quantity = _quantity(key, shape)
            Section(_written(quantity, text), WHERE, "cover").read(quantity)
    except InputError as error:
        return str(error)
    return None


def read_form(typed: Typed, camera: Camera | None = None) -> Setup:
    """The set-up, with the camera of another session if there is one; an InputError says what to write instead."""
    board = {key: _number(text) for key, text in typed.board.items()}
    cover: dict[str, object] = {"shape": typed.shape}
    for quantity in SHAPES[typed.shape]:
        cover |= _written(quantity, typed.cover.get(quantity.key, ""))
    return session_from_mapping(_mapping(board, cover, camera), WHERE)


def write_form(board: Board, cover: Cover) -> Typed:
    """The texts that read as this board and cover."""
    written = session_to_yaml(board, Camera(1, 1), cover)["board"]
    assert isinstance(written, Mapping)
    texts = {key: _text(value) for key, value in cover_to_yaml(cover).items() if key != "shape"}
    return Typed({key: _text(written[key]) for key in BOARD}, cover.shape, texts)


def _mapping(board: Mapping[str, object], cover: Mapping[str, object], camera: Camera | None = None) -> dict[str, object]:
    return {"board": board, "camera": camera_to_yaml(camera or Camera(1, 1)), "cover": cover}  # the size is the first picture's


def _quantity(key: str, shape: str) -> Quantity:
    return next(quantity for quantity in SHAPES[shape] if quantity.key == key)


def _written(quantity: Quantity, text: str) -> dict[str, object]:
    """As session.yaml would have it; nothing where an empty text leaves the default."""
    if not text.strip() and quantity.default is not None:
        return {}
    if not quantity.components:
        return {quantity.key: _number(text)}
    return {quantity.key: [_number(part) for part in re.split(r"[,;\s]+", _joined(text).strip(" []"))]}


def _number(text: str) -> object:
    """A number, `25 ± 10` (or `25 +- 10`) as a number with its sigma, 0 for an exact one, or the text itself, which the rules refuse."""
    value, pair, sigma = _joined(text.strip()).partition("±")
    try:
        if pair:
            return {"value": float(value), "sigma": float(sigma)}
        return int(value) if value.lstrip("+-").isdecimal() else float(value)
    except ValueError:
        return text.strip() or None


def _joined(text: str) -> str:
    """With every number and its sigma as one word."""
    return re.sub(r"\s*(±|\+-)\s*", "±", text)


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    if isinstance(value, Mapping):
        return f"{_text(value['value'])} ± {_text(value.get('sigma', 0.0))}"  # an exact number has no sigma
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
