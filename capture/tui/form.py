"""The set-up as a person types it: texts in, checked by the session's own rules, a set-up out.

Pure.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from calib.errors import InputError, brief
from calib.session.board import Board
from calib.session.board_section import EXPLANATIONS, KEYS, UNUSUAL, explain_keys
from calib.session.camera import Camera, camera_to_yaml
from calib.session.cover import Cover
from calib.session.cover_section import LAYERS_KEY, cover_mappings
from calib.session.dispersion import COLOUR_KEYS
from calib.session.schema import UNKNOWN, Quantity, Section, is_unknown
from calib.session.session import session_from_mapping, session_to_yaml
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, MEDIA, OUTSIDE, WATER
from calib.session.shapes.registry import find_shape
from calib.session.tolerances import ANY_WATER
from calib.session.typed_number import join_sigmas, typed_number
from capture.session_file import Setup

BOARD = {
    kind: tuple(key for key in keys if key not in ("type", *UNUSUAL)) for kind, keys in KEYS.items()
}
"""The keys that a person types for each type of board. Unusual ones come from a session."""
FORM_NAME = "The set-up"
EXAMPLE_BOARDS: Mapping[str, Mapping[str, object]] = {
    "checkerboard": {"columns": 3, "rows": 3, "square_mm": 1},
    "charuco": {
        "columns": 3,
        "rows": 3,
        "square_mm": 1e5,
        "marker_mm": 0.05,
        "dictionary": "DICT_APRILTAG_36h10",
    },
    "aprilgrid": {"columns": 2, "rows": 2, "tag_mm": 1, "spacing": 0.3},
    "gridboard": {
        "columns": 2,
        "rows": 2,
        "tag_mm": 1,
        "spacing": 0.3,
        "dictionary": "DICT_APRILTAG_36h10",
    },
}
"""Valid example values for each type of board: a single value is checked together with them."""
DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+([.,][0-9]+)?(±[0-9]+([.,][0-9]+)?)?")
"""A number, with its sigma or without, and perhaps with a decimal comma."""
ROUGHLY = "{example} alone means {example} +- {sigma}. "
"""How a number is written that is known roughly."""
EACH_ROUGHLY = "Each number alone means +- {sigma}. "
EXAMPLES = {"thickness_mm": 3.0, "refractive_index": 1.5, "radius_slope": -0.1, "tilt_deg": 2.0}
"""Example values of the numbers of a cover; the others are millimetres."""
UNKNOWN_KEY = "?"
"""The key that writes UNKNOWN into a field of the cover, and the short way to write it."""
NOT_KNOWN = f"{UNKNOWN_KEY} if you do not know."
LAYER_KEYS = tuple(kind.quantity.key for kind in LAYER)
"""The keys that have a number for each layer of glass."""
NUMBERS = ("one", "two", "three")
ANSWERS = {"yes": True, "no": False, "true": True, "false": False}

NO_COVER = "none: there is none, only the lens is calibrated; unknown: the fit finds out."
CHOOSE_SHAPE = f"Choose the shape of the cover. {NO_COVER}"
HELP = EXPLANATIONS | {
    "kind": (
        "What is printed on it. charuco, aprilgrid and gridboard have markers, and may reach out of"
        " the picture."
    ),
    "shape": f"The cover in front of the camera. {NO_COVER}",
}
"""The explanations of the values of a board, and of the choices. A shape explains its own.

The rule of a value is stated when it is broken.
"""


@dataclass(frozen=True, slots=True)
class FormTexts:
    """All texts of the form, by the keys of session.yaml."""

    board: Mapping[str, str]
    shape: str
    cover: Mapping[str, str]
    """The texts of its numbers. Thickness and index may have a number for each layer of glass."""
    kind: str = "checkerboard"
    outer: tuple[Mapping[str, object], ...] = ()
    """Further covers outside of this one, as session.yaml has them. The form keeps them."""
    unusual: Mapping[str, object] = field(default_factory=dict)
    """The board's keys without a field, as session.yaml has them. The form keeps them."""


def explain_field(key: str, kind: str, shape: str) -> str:
    """Return the explanation of a value, for a board of this type or a cover of this shape."""
    board = explain_keys(kind)
    cover = {
        entry.quantity.key: " ".join((entry.typed, f"{_roughly(entry)}{NOT_KNOWN}"))
        for entry in find_shape(shape).keys
    }
    words = find_shape(shape).words
    chosen = {"shape": f"The cover in front of the camera: {words}. {NO_COVER}"} if cover else {}
    if shape == UNKNOWN:
        chosen = {"shape": CHOOSE_SHAPE}
    return (HELP | board | cover | chosen).get(key, "")


def _roughly(entry: Dimension) -> str:
    """Return a sentence on the tolerance of a number; empty if it has none."""
    if entry is OUTSIDE:
        return ROUGHLY.format(sigma=ANY_WATER.sigma, example=MEDIA[WATER])
    if not entry.tolerance:
        return ""
    sigma = entry.tolerance.sigma * entry.quantity.unit[1]
    if entry.quantity.components:
        return EACH_ROUGHLY.format(sigma=f"{sigma:.2g}")
    example = EXAMPLES.get(entry.quantity.key, 50.0)
    return ROUGHLY.format(sigma=f"{sigma:.2g}", example=f"{example:g}")


def find_problem(key: str, text: str, shape: str, kind: str = "checkerboard") -> str | None:
    """Return the error in one value by itself, or None. A field that this shape and type do not
    have is about to disappear, so it has no error.
    """
    try:
        if key in BOARD[kind]:
            _check_point(f"board.{key}", text)
            session_from_mapping(
                _mapping(
                    {"type": kind, **EXAMPLE_BOARDS[kind], key: _value(key, text)},
                    {"shape": "none"},
                ),
                FORM_NAME,
            )
        elif quantity := _quantity(key, shape):
            layers = [{key: number} for number in _layer_numbers(quantity, text)]
            for mapping in layers or [_to_yaml(quantity, text)]:
                Section(mapping, FORM_NAME, "cover").read(quantity)
    except InputError as error:
        return str(error)
    return None


def read_form(texts: FormTexts, camera: Camera | None = None) -> Setup:
    """Return the set-up, with the camera of another session if there is one; an InputError says
    what to write instead.
    """
    for key, text in texts.board.items():
        _check_point(f"board.{key}", text)
    typed_board = {key: _value(key, text) for key, text in texts.board.items()}
    unusual = {key: texts.unusual[key] for key in texts.unusual if key in KEYS[texts.kind]}
    board = {"type": texts.kind, **typed_board, **unusual}
    cover = _cover_to_yaml(texts)
    covers = [cover, *texts.outer] if texts.outer else cover
    return session_from_mapping(_mapping(board, covers, camera), FORM_NAME)


def write_form(board: Board, cover: Cover) -> FormTexts:
    """Return the texts that read as this board and cover."""
    written = session_to_yaml(board, Camera(1, 1), cover)["board"]
    assert isinstance(written, Mapping)
    inner, *outer = cover_mappings(cover)
    layers = inner.pop(LAYERS_KEY, [])
    texts = {key: _text(value) for key, value in inner.items() if key != "shape"}
    if isinstance(layers, list) and layers:
        texts |= {key: _text([layer[key] for layer in layers]) for key in LAYER_KEYS}
    kind = str(written.get("type", "checkerboard"))
    typed_board = {key: _text(written[key]) for key in BOARD[kind]}
    unusual = {key: value for key, value in written.items() if key in UNUSUAL}
    return FormTexts(typed_board, cover.shape, texts, kind, tuple(outer), unusual)


def _mapping(
    board: Mapping[str, object], cover: object, camera: Camera | None = None
) -> dict[str, object]:
    return {
        "board": board,
        "camera": camera_to_yaml(camera or Camera(1, 1)),
        "cover": cover,
    }  # the size comes from the first picture


def _cover_to_yaml(texts: FormTexts) -> dict[str, object]:
    """Return the cover of the form as in session.yaml, without those outside of it. Raise
    InputError if some numbers of its layers are missing.
    """
    cover: dict[str, object] = {"shape": texts.shape}
    columns: dict[str, list[object]] = {}
    for dimension in find_shape(texts.shape).keys:
        quantity = dimension.quantity
        text = texts.cover.get(quantity.key, "")
        if numbers := _layer_numbers(quantity, text):
            columns[quantity.key] = numbers
        else:
            cover |= _to_yaml(quantity, text)
    if not columns:
        return cover
    fewest, most = sorted(LAYER_KEYS, key=lambda key: len(columns.get(key, ())))
    if len(columns.get(fewest, ())) < len(columns[most]):
        written = brief(texts.cover.get(fewest, "").strip()) or "empty"
        raise InputError(
            f"{FORM_NAME}: cover.{fewest} is {written} where cover.{most} has"
            f" {len(columns[most])} layers of glass: write a number for each, from the inside out."
        )
    rows = zip(*(columns[key] for key in LAYER_KEYS), strict=True)
    return cover | {LAYERS_KEY: [dict(zip(LAYER_KEYS, row, strict=True)) for row in rows]}


def _layer_numbers(quantity: Quantity, text: str) -> list[object]:
    """Return the numbers of several layers of glass; none if the text is not several numbers."""
    if quantity.key not in LAYER_KEYS:
        return []
    _check_point(f"cover.{quantity.key}", text)
    entries = _split_list(text)
    if len(entries) < 2 or not all(
        DECIMAL_COMMA.fullmatch(entry) or _is_unknown(entry) for entry in entries
    ):
        return []
    _check_points(f"cover.{quantity.key}", text, 0)
    return [_typed(entry) for entry in entries]


def _quantity(key: str, shape: str) -> Quantity | None:
    quantities = (dimension.quantity for dimension in find_shape(shape).keys)
    return next((quantity for quantity in quantities if quantity.key == key), None)


def _to_yaml(quantity: Quantity, text: str) -> dict[str, object]:
    """Return the key and value as in session.yaml; nothing where an empty text leaves the
    default.
    """
    if not text.strip() and quantity.default is not None:
        return {}
    if quantity.wide and _is_unknown(text):
        return {quantity.key: UNKNOWN}
    if not quantity.components:
        _check_point(f"cover.{quantity.key}", text)
        return {quantity.key: _typed(text)}
    _check_points(f"cover.{quantity.key}", text, len(quantity.components))
    if len(_split_list(text)) != len(quantity.components):
        first, *names_after_first = quantity.components
        raise InputError(
            f"{FORM_NAME}: cover.{quantity.key} is {brief(text.strip()) or 'empty'}: write"
            f" {NUMBERS[len(names_after_first)]} numbers,"
            f" {', '.join((first, *names_after_first[:-1]))} and {names_after_first[-1]}, such as"
            f" {', '.join('0' for _ in quantity.components)}."
        )
    return {quantity.key: [_typed(component) for component in _split_list(text)]}


def _check_point(key: str, text: str) -> None:
    """Raise InputError where a single number, or its sigma, has a decimal comma."""
    if DECIMAL_COMMA.fullmatch(join_sigmas(text.strip())) and "," in text:
        raise InputError(
            f"{FORM_NAME}: {key} is {text.strip()}: write"
            f" {_with_points([join_sigmas(text.strip())])}, with a point."
        )


def _check_points(key: str, text: str, count: int) -> None:
    """Raise InputError where commas among the digits of a list of this length may be decimal
    commas.

    `1,2,3` and `0,-30` can only be lists.
    """
    words = [
        word for word in re.split(r"[;\s]+|,(?![0-9])", join_sigmas(text).strip(" []")) if word
    ]
    if not any("," in word for word in words) or not all(map(DECIMAL_COMMA.fullmatch, words)):
        return
    components = _split_list(text)
    alternative = (
        f", or {', '.join(components).replace('±', ' ± ')}, with a blank, for {count} numbers"
        if len(components) == count
        else ""
    )
    raise InputError(
        f"{FORM_NAME}: {key} is {text.strip()}: write {_with_points(words)}, with a"
        f" point{alternative}."
    )


def _split_list(text: str) -> list[str]:
    """Return the components of a list, separated by commas, semicolons and blanks."""
    return re.split(r"[,;\s]+", join_sigmas(text).strip(" []"))


def _with_points(numbers: list[str]) -> str:
    return ", ".join(number.replace(",", ".") for number in numbers).replace("±", " ± ")


def _value(key: str, text: str) -> object:
    """Return a value of a board."""
    return (
        ANSWERS.get(text.strip().lower(), text.strip()) if key == "legacy_pattern" else _typed(text)
    )


def _typed(text: str) -> object:
    """Return the number or the text of a field, in which `UNKNOWN_KEY` means that nobody knows."""
    return UNKNOWN if _is_unknown(text) else typed_number(text)


def _is_unknown(text: str) -> bool:
    return is_unknown(text) or text.strip() == UNKNOWN_KEY


def _text(value: object) -> str:
    if isinstance(value, bool | str):
        return value if isinstance(value, str) else "yes" if value else "no"
    if isinstance(value, list):
        return UNKNOWN if all(map(is_unknown, value)) else ", ".join(map(_text, value))
    if isinstance(value, Mapping):
        colours = [f" {key} {_text(value[key])}" for key in COLOUR_KEYS if key in value]
        exact = value.get("exact") or not colours  # an exact number has no sigma
        sigma = f" ± {_text(value.get('sigma', 0.0))}" if exact or "sigma" in value else ""
        return f"{_text(value['value'])}{sigma}{''.join(colours)}"
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
