"""The options that describe a board on a command line, and the board that they describe."""

import argparse
from typing import TYPE_CHECKING

from calib.commands.arguments import Options, millimetres, positive_number
from calib.errors import InputError
from calib.session.coding import BORDERS, DICTIONARIES, FIRST_ROWS, ROTATIONS_DEG, TYPES

if TYPE_CHECKING:
    from calib.session.board import Board

OPTIONS = (
    "type",
    "square_mm",
    "marker_mm",
    "dictionary",
    "legacy_pattern",
    "tag_mm",
    "spacing",
    "first_marker",
    "border_cells",
    "numbered_from",
    "tag_rotation_deg",
    "inverted",
)
"""The names that session.yaml has for the options."""


def add_coding(parser: Options, coded: Options | None = None) -> None:
    """Add the options that a board needs besides --board and --square-mm.

    Args:
        coded: the group for those of a board with markers or tags; by default there is none.
    """
    parser.add_argument(
        "--type",
        choices=TYPES,
        metavar="KIND",
        help=f"kind of board: {', '.join(TYPES)} (default: checkerboard)",
    )
    parser.add_argument(
        "--inverted",
        action="store_true",
        default=None,
        help="the board is printed white on black",
    )
    parser = coded or parser
    parser.add_argument(
        "--marker-mm", type=millimetres, metavar="MM", help="side of a charuco's marker"
    )
    parser.add_argument(
        "--dictionary",
        choices=tuple(DICTIONARIES),
        metavar="NAME",
        help="dictionary of a charuco's or a gridboard's markers, such as DICT_4X4_250",
    )
    parser.add_argument(
        "--legacy-pattern",
        action="store_true",
        default=None,
        help="a charuco begins with a white square, as those of calib.io and OpenCV before 4.6",
    )
    parser.add_argument(
        "--tag-mm",
        type=millimetres,
        metavar="MM",
        help="side of an aprilgrid's or a gridboard's tag, instead of --square-mm",
    )
    parser.add_argument(
        "--spacing",
        type=positive_number,
        metavar="FRACTION",
        help="gap between a grid's tags, as a fraction of a tag's side, such as 0.3",
    )
    parser.add_argument(
        "--first-marker",
        type=int,
        metavar="NUMBER",
        help="number of the board's first marker (default: 0)",
    )
    parser.add_argument(
        "--border-cells",
        type=int,
        choices=BORDERS,
        metavar="COUNT",
        help="cells of black around an aprilgrid's tags: 1 or 2 (default: 2, as Kalibr's have)",
    )
    parser.add_argument(
        "--numbered-from",
        choices=FIRST_ROWS,
        metavar="CORNER",
        help="first tag of an aprilgrid: lower_left or upper_left (default: lower_left, Kalibr's)",
    )
    parser.add_argument(
        "--tag-rotation-deg",
        type=int,
        choices=ROTATIONS_DEG,
        metavar="DEG",
        help=(
            "turn of an aprilgrid's tags, clockwise against OpenCV's: 0, 90, 180 or 270 (default:"
            " 180, Kalibr's)"
        ),
    )


def board_from_options(args: argparse.Namespace) -> "Board | None":
    """Return the board that the options describe; None if no option describes it."""
    from calib.session.board_section import read_board
    from calib.session.schema import Section

    options = {key: value for key in OPTIONS if (value := getattr(args, key, None)) is not None}
    if args.board is None and not options:
        return None
    if args.board is None:
        raise InputError(
            "--board and --square-mm belong together: add --board COLSxROWS, the inner corners of a"
            " row and of a column, or the tags of a grid."
        )
    if not options.keys() & {"square_mm", "tag_mm"}:
        raise InputError(
            "--board and --square-mm belong together: add --square-mm MM, the side of a square; an"
            " aprilgrid or a gridboard has --tag-mm instead."
        )
    columns, rows = args.board
    return read_board(Section({"columns": columns, "rows": rows, **options}, "The command line"))
