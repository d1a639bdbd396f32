"""Read and write the section `board` of session.yaml: a checkerboard, a ChArUco board, Kalibr's
AprilGrid, or OpenCV's GridBoard.
"""

from collections.abc import Mapping

from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import (
    BORDERS,
    DICTIONARIES,
    FIRST_ROWS,
    ROTATIONS_DEG,
    SPACING_LIMITS,
    TYPES,
    AprilGrid,
    Charuco,
    Coding,
    grid_board,
)
from calib.session.schema import Number, Quantity, Section, T

SQUARE = Quantity("square_mm", low=0.05, high=1e5)
TAG = Quantity("tag_mm", low=0.05, high=1e5)
MARKER = Quantity("marker_mm", low=0.05, high=1e5)
SPACING = Quantity("spacing", low=SPACING_LIMITS[0], high=SPACING_LIMITS[1])
KEYS = {
    "checkerboard": ("type", "columns", "rows", "square_mm"),
    "charuco": (
        "type",
        "columns",
        "rows",
        "square_mm",
        "marker_mm",
        "dictionary",
        "legacy_pattern",
        "first_marker",
        "inverted",
    ),
    "aprilgrid": (
        "type",
        "columns",
        "rows",
        "tag_mm",
        "spacing",
        "first_marker",
        "border_cells",
        "numbered_from",
        "tag_rotation_deg",
        "inverted",
    ),
    "gridboard": (
        "type",
        "columns",
        "rows",
        "tag_mm",
        "spacing",
        "dictionary",
        "first_marker",
        "inverted",
    ),
}
UNUSUAL = ("first_marker", "inverted", "border_cells", "numbered_from", "tag_rotation_deg")
"""The keys that are written only where a board is not as usual."""
KALIBR = AprilGrid(0.3)
"""The board whose numbering and border an aprilgrid has by default."""
EXAMPLES: Mapping[str, Mapping[str, object]] = {
    "checkerboard": {"columns": 9, "rows": 6, "square_mm": 25.0},
    "charuco": {
        "columns": 9,
        "rows": 6,
        "square_mm": 25.0,
        "marker_mm": 18.75,
        "dictionary": "DICT_4X4_250",
        "legacy_pattern": False,
    },
    "aprilgrid": {"columns": 6, "rows": 6, "tag_mm": 30.0, "spacing": 0.3},
    "gridboard": {
        "columns": 7,
        "rows": 5,
        "tag_mm": 30.0,
        "spacing": 0.2,
        "dictionary": "DICT_4X4_250",
    },
}
"""An example of each type's keys."""
EXPLANATIONS = {
    "columns": "The board's inner corners along one row: one less than its squares.",
    "rows": "The board's inner corners along one column: one less than its squares.",
    "square_mm": "The side of one square in millimetres. Measure over many squares and divide.",
    "marker_mm": "The side of one marker in millimetres, with its black border.",
    "dictionary": (
        "The name of its markers, as OpenCV has it, such as DICT_4X4_250; it often stands on the"
        " print."
    ),
    "legacy_pattern": (
        "true for boards of calib.io, or of OpenCV before 4.6, whose upper left square is white;"
        " else false."
    ),
    "tag_mm": "The side of one tag in millimetres, with its black border.",
    "spacing": "The gap between two tags, in sides of a tag: 0.3 on Kalibr's own.",
    "first_marker": "The number of the board's first marker, if it is not 0.",
    "inverted": "true if the board is printed white on black.",
    "border_cells": "The width of a tag's black border, in cells: 2 on Kalibr's, 1 on others.",
    "numbered_from": "The tag that has the first number, lower_left on Kalibr's or upper_left.",
    "tag_rotation_deg": "The turn of the tags against OpenCV's, clockwise: 180 on Kalibr's.",
}
"""The explanation of each key, for someone who has never seen a session.yaml."""
TAG_EXPLANATIONS = {
    "columns": "How many tags there are along one row.",
    "rows": "How many tags there are along one column.",
}
"""The explanations that differ for a grid of tags."""


def explain_keys(kind: str) -> dict[str, str]:
    """Return the explanation of each key of a board of this type but `type` itself."""
    special = TAG_EXPLANATIONS if "tag_mm" in KEYS[kind] else {}
    return {key: (EXPLANATIONS | special)[key] for key in KEYS[kind] if key != "type"}


def read_board(section: Section) -> Board:
    """Read the board; raise InputError if the section is not valid."""
    kind = (
        section.choice("type", TYPES, ", ".join(TYPES[:-1]) + f" or {TYPES[-1]}")
        if "type" in section.values
        else "checkerboard"
    )
    key_kind = f"key of type {kind}" if "type" in section.values else "known key"
    section.allow_only(KEYS[kind], key_kind)
    if kind in ("aprilgrid", "gridboard"):
        return _grid(section, kind)
    columns = section.integer("columns", 3, 1000)
    rows = section.integer("rows", 3, 1000)
    square = section.read(SQUARE)["square"]
    board = Board(columns, rows, square.value, _sigma(square))
    return board if kind == "checkerboard" else _charuco(section, board)


def board_to_yaml(board: Board) -> dict[str, object]:
    """Return the mapping that `read_board` reads as the same board."""
    side = Number(board.square, board.square_sigma or 0.0, exact=board.square_sigma == 0)
    size: dict[str, object] = {"columns": board.columns, "rows": board.rows}
    match board.coding:
        case None:
            return {**size, "square_mm": SQUARE.to_yaml(side)}
        case Charuco(marker, dictionary, legacy_pattern) as charuco:
            marker_mm = MARKER.to_yaml(Number(marker))
            sides = {"square_mm": SQUARE.to_yaml(side), "marker_mm": marker_mm}
            return {
                "type": "charuco",
                **size,
                **sides,
                "dictionary": dictionary,
                "legacy_pattern": legacy_pattern,
                **_numbering_to_yaml(charuco),
            }
        case AprilGrid(spacing) as grid:
            tags = {"columns": board.columns // 2, "rows": board.rows // 2}
            sides = {"tag_mm": TAG.to_yaml(side), "spacing": spacing}
            if not grid.crossings:
                return {
                    "type": "gridboard",
                    **tags,
                    **sides,
                    "dictionary": grid.dictionary,
                    **_numbering_to_yaml(grid),
                }
            differences = {
                "border_cells": (grid.border, KALIBR.border),
                "numbered_from": (grid.numbered_from, KALIBR.numbered_from),
                "tag_rotation_deg": (grid.rotation_deg, KALIBR.rotation_deg),
            }
            layout = {key: value for key, (value, usual) in differences.items() if value != usual}
            return {"type": "aprilgrid", **tags, **sides, **layout, **_numbering_to_yaml(grid)}


def _numbering_to_yaml(coding: Coding) -> dict[str, object]:
    """Return the keys that any board with markers may have, if they are not as usual."""
    first = {"first_marker": coding.first_marker} if coding.first_marker else {}
    return {**first, **({"inverted": True} if coding.inverted else {})}


def _charuco(section: Section, plain: Board) -> Board:
    """Add the section's markers to a plain checkerboard."""
    marker = section.read(MARKER)["marker"]
    if not marker.value < plain.square:
        raise section.error(
            "marker_mm",
            section.values["marker_mm"],
            "less than square_mm: the markers lie inside the squares",
        )
    dictionary = _dictionary(section)
    coding = Charuco(
        marker.value,
        dictionary,
        _flag(section, "legacy_pattern"),
        _first_marker(section),
        _flag(section, "inverted"),
    )
    _check_markers(section, (plain.columns + 1) * (plain.rows + 1) // 2, coding)
    return Board(plain.columns, plain.rows, plain.square, plain.square_sigma, coding)


def _grid(section: Section, kind: str) -> Board:
    columns = section.integer("columns", 2, 500)
    rows = section.integer("rows", 2, 500)
    tag = section.read(TAG)["tag"]
    spacing = section.read(SPACING)["spacing"].value
    first = _first_marker(section)
    inverted = _flag(section, "inverted")
    if kind == "gridboard":
        coding = grid_board(spacing, _dictionary(section), first, inverted=inverted)
    else:
        coding = AprilGrid(
            spacing,
            first_marker=first,
            border=_option(section, "border_cells", BORDERS, KALIBR.border),
            numbered_from=_option(section, "numbered_from", FIRST_ROWS, KALIBR.numbered_from),
            rotation_deg=_option(section, "tag_rotation_deg", ROTATIONS_DEG, KALIBR.rotation_deg),
            inverted=inverted,
        )
    _check_markers(section, columns * rows, coding)
    return Board(2 * columns, 2 * rows, tag.value, _sigma(tag), coding)


def _dictionary(section: Section) -> str:
    expected = "one of OpenCV's names, such as DICT_4X4_250"
    return section.choice("dictionary", tuple(DICTIONARIES), expected)


def _first_marker(section: Section) -> int:
    if "first_marker" not in section.values:
        return 0
    return section.integer("first_marker", 0, max(DICTIONARIES.values()) - 1)


def _flag(section: Section, key: str) -> bool:
    value = section.values.get(key, False)
    if not isinstance(value, bool):
        raise section.error(key, value, "true or false")
    return value


def _option(section: Section, key: str, options: tuple[T, ...], default: T) -> T:
    """Return the option that the key names, or the default."""
    if key not in section.values:
        return default
    return section.choice(key, options, f"one of {', '.join(map(str, options))}")


def _check_markers(section: Section, needed: int, coding: Coding) -> None:
    """Raise InputError if the dictionary has fewer markers than the board needs."""
    count = DICTIONARIES[coding.dictionary]
    if coding.first_marker + needed > count:
        start = f" from {coding.first_marker} on" if coding.first_marker else ""
        keys = "columns, rows, first_marker" if coding.first_marker else "columns and rows"
        raise InputError(
            f"{section.file}: {section.path} needs {needed} markers{start} where"
            f" {coding.dictionary} has {count}: correct {keys}, or the dictionary."
        )


def _sigma(side: Number) -> float | None:
    """Return the side's standard deviation, 0 if it is exact, None if it is not stated."""
    return side.sigma if side.sigma or side.exact else None
