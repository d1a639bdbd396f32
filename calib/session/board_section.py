"""Read and write the section `board` of session.yaml: a checkerboard, a ChArUco board, or Kalibr's
AprilGrid.
"""

from collections.abc import Mapping

from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import DICTIONARIES, SPACING_LIMITS, TYPES, AprilGrid, Charuco
from calib.session.schema import Number, Quantity, Section

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
    ),
    "aprilgrid": ("type", "columns", "rows", "tag_mm", "spacing"),
}
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
        "yes for boards of calib.io, or of OpenCV before 4.6, whose upper left square is white;"
        " else no."
    ),
    "tag_mm": "The side of one tag in millimetres, with its black border.",
    "spacing": "The gap between two tags, in sides of a tag: 0.3 on Kalibr's own.",
}
"""The explanation of each key, for someone who has never seen a session.yaml."""
TAG_EXPLANATIONS = {
    "columns": "How many tags there are along one row.",
    "rows": "How many tags there are along one column.",
}
"""The explanations that differ for an aprilgrid."""


def explain_keys(kind: str) -> dict[str, str]:
    """Return the explanation of each key of a board of this type but `type` itself."""
    special = TAG_EXPLANATIONS if kind == "aprilgrid" else {}
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
    if kind == "aprilgrid":
        return _aprilgrid(section)
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
        case Charuco(marker, dictionary, legacy_pattern):
            marker_mm = MARKER.to_yaml(Number(marker))
            sides = {"square_mm": SQUARE.to_yaml(side), "marker_mm": marker_mm}
            return {
                "type": "charuco",
                **size,
                **sides,
                "dictionary": dictionary,
                "legacy_pattern": legacy_pattern,
            }
        case AprilGrid(spacing):
            tags = {"columns": board.columns // 2, "rows": board.rows // 2}
            return {"type": "aprilgrid", **tags, "tag_mm": TAG.to_yaml(side), "spacing": spacing}


def _charuco(section: Section, plain: Board) -> Board:
    """Add the section's markers to a plain checkerboard."""
    marker = section.read(MARKER)["marker"]
    if not marker.value < plain.square:
        raise section.error(
            "marker_mm",
            section.values["marker_mm"],
            "less than square_mm: the markers lie inside the squares",
        )
    dictionary = section.choice(
        "dictionary", tuple(DICTIONARIES), "one of OpenCV's names, such as DICT_4X4_250"
    )
    legacy = section.values.get("legacy_pattern", False)
    if not isinstance(legacy, bool):
        raise section.error("legacy_pattern", legacy, "true or false")
    _check_markers(section, (plain.columns + 1) * (plain.rows + 1) // 2, dictionary)
    return Board(
        plain.columns,
        plain.rows,
        plain.square,
        plain.square_sigma,
        Charuco(marker.value, dictionary, legacy),
    )


def _aprilgrid(section: Section) -> Board:
    columns = section.integer("columns", 2, 500)
    rows = section.integer("rows", 2, 500)
    tag = section.read(TAG)["tag"]
    spacing = section.read(SPACING)["spacing"]
    coding = AprilGrid(spacing.value)
    _check_markers(section, columns * rows, coding.dictionary)
    return Board(2 * columns, 2 * rows, tag.value, _sigma(tag), coding)


def _check_markers(section: Section, needed: int, dictionary: str) -> None:
    """Raise InputError if the dictionary has fewer markers than the board needs."""
    if needed > DICTIONARIES[dictionary]:
        raise InputError(
            f"{section.file}: {section.path} needs {needed} markers where {dictionary} has"
            f" {DICTIONARIES[dictionary]}: correct columns and rows, or the dictionary."
        )


def _sigma(side: Number) -> float | None:
    """Return the side's standard deviation, 0 if it is exact, None if it is not stated."""
    return side.sigma if side.sigma or side.exact else None
