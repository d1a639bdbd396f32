"""The command `calib board`."""

import argparse
import math
from typing import TYPE_CHECKING

from calib.commands.arguments import (
    add_output,
    add_overwrite,
    doubt_unit,
    millimetres,
    quoted,
    whole_size,
)
from calib.commands.printing import print_remark
from calib.errors import InputError
from calib.io.numerals import whole_number
from calib.session.coding import DICTIONARIES, SPACING_LIMITS

if TYPE_CHECKING:
    from calib.sheet.paper import Paper
    from calib.sheet.sheet import Sheet
    from calib.sheet.target import Pattern

SUMMARY = "Draw a board to print: board.pdf and board.svg at true scale, and a session.yaml."
DESCRIPTION = """
The board is a checkerboard, a ChArUco board or Kalibr's AprilGrid. With markers, a picture that
shows only a part of the board is enough. The sheet has two rulers. It says what to measure after
printing, and where to enter the result. Without --square-mm or --tag-mm, squares or tags get the
largest whole number of millimetres that leaves a white margin as wide as one of them.
"""
EXAMPLES = (
    "calib board -o cam0",
    "calib board --type charuco --columns 11 --rows 8 --paper A3 -o cam0",
)

OPTIONS = ("square_mm", "tag_mm", "spacing", "marker", "dictionary", "legacy_pattern")
BY_TYPE = {
    "checkerboard": ("square_mm",),
    "charuco": ("square_mm", "marker", "dictionary", "legacy_pattern"),
    "aprilgrid": ("tag_mm", "spacing"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--type", choices=tuple(BY_TYPE), default="checkerboard", help="the kind of board"
    )
    parser.add_argument(
        "--columns",
        type=_count,
        metavar="N",
        help="inner corners along x (default: 9); for an aprilgrid, tags along x (default: 6)",
    )
    parser.add_argument(
        "--rows", type=_count, metavar="N", help="inner corners or tags along y (default: 6)"
    )
    parser.add_argument("--square-mm", type=millimetres, metavar="MM", help="side of a square")
    parser.add_argument(
        "--tag-mm", type=millimetres, metavar="MM", help="side of an aprilgrid's tag"
    )
    parser.add_argument(
        "--spacing",
        type=_spacing,
        metavar="FRACTION",
        help="gap between an aprilgrid's tags, as a fraction of a tag's side (default: 0.3)",
    )
    parser.add_argument(
        "--marker",
        type=_marker_fraction,
        metavar="FRACTION",
        help="side of a charuco's marker, as a fraction of a square's side (default: 0.75)",
    )
    parser.add_argument(
        "--dictionary",
        choices=tuple(DICTIONARIES),
        metavar="NAME",
        help="dictionary of a charuco's markers (default: DICT_4X4_250)",
    )
    legacy = (
        "a charuco board of calib.io, or of OpenCV before 4.6: if it has an even number of rows of"
        " squares, it begins with a white square"
    )
    parser.add_argument("--legacy-pattern", action="store_true", default=None, help=legacy)
    parser.add_argument(
        "--paper",
        type=_parse_papers,
        default="A4",
        metavar="PAPER",
        help="A4, A3, Letter, or width x height in mm, such as 600x400 (default: A4)",
    )
    size = (
        "size of the camera's pictures, for session.yaml; correct it there if it differs (default:"
        " 1640x1232)"
    )
    parser.add_argument("--size", type=whole_size, default=(1640, 1232), metavar="WxH", help=size)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_output(parser, "the folder of a new session, for the files", required=True)
    add_overwrite(parser)


def run(args: argparse.Namespace) -> None:
    from calib.commands.printing import print_json, print_paths
    from calib.io.file_set import FileSet
    from calib.io.files import reading
    from calib.sheet.layout import lay_out
    from calib.sheet.pdf import to_pdf
    from calib.sheet.starting_session import starting_session
    from calib.sheet.svg import to_svg

    session = args.output / "session.yaml"
    with reading(session):
        if session.exists() and not args.overwrite:
            raise InputError(
                f"{session} is there already, and no session is overwritten: give another folder"
                " with -o, or replace its session.yaml with --overwrite."
            )
    pattern = _pattern(args)
    for option, side in (("--square-mm", args.square_mm), ("--tag-mm", args.tag_mm)):
        if side and (doubt := doubt_unit(option, side)):
            print_remark(doubt)
    sheet = lay_out(pattern, args.paper, args.square_mm or args.tag_mm)
    with FileSet(args.output, overwrite=args.overwrite) as files:
        files.reserve(["board.pdf", "board.svg", "session.yaml"])
        written = (
            files.write("board.pdf", to_pdf(sheet)),
            files.write("board.svg", to_svg(sheet)),
            files.write("session.yaml", starting_session(pattern, sheet, args.size)),
        )
        files.commit()
    if args.json:
        print_json(
            _as_mapping(args.type, pattern, sheet) | {"written": [str(path) for path in written]}
        )
    else:
        print_paths(written)
    for remark in _remarks(pattern, sheet):
        print_remark(remark)


def _pattern(args: argparse.Namespace) -> "Pattern":
    from calib.sheet.aprilgrid import AprilGridPattern
    from calib.sheet.charuco import CharucoPattern
    from calib.sheet.checkerboard import CheckerboardPattern

    for option in OPTIONS:
        if getattr(args, option) is not None and option not in BY_TYPE[args.type]:
            raise InputError(
                f"--{option.replace('_', '-')} does not apply to a board of --type {args.type}:"
                " leave it out."
            )
    shape_options = set(BY_TYPE[args.type]) - {"square_mm", "tag_mm"}
    shape = {
        option: value for option in shape_options if (value := getattr(args, option)) is not None
    }
    columns = args.columns or (6 if args.type == "aprilgrid" else 9)
    rows = args.rows or 6
    if args.type == "aprilgrid":
        return AprilGridPattern(columns, rows, **shape)
    if min(columns, rows) < 3:
        raise InputError(
            f"a board of --type {args.type} has 3 corners or more in each direction: write"
            " --columns 9 --rows 6, say."
        )
    if args.type == "charuco":
        return CharucoPattern(columns, rows, **shape)
    return CheckerboardPattern(columns, rows)


def _as_mapping(kind: str, pattern: "Pattern", sheet: "Sheet") -> dict[str, object]:
    return {
        "type": kind,
        "board": pattern.to_yaml(sheet.side, sheet.side),
        "paper_mm": [sheet.paper.width, sheet.paper.height],
        "rulers_mm": list(sheet.rulers),
        "corners_mm": [list(corner) for corner in sheet.corners],
    }


def _remarks(pattern: "Pattern", sheet: "Sheet") -> list[str]:
    from calib.sheet.checkerboard import CheckerboardPattern

    remarks = []
    if sheet.white < sheet.side:
        remarks.append(
            f"The white margin is {sheet.white:.1f} mm, narrower than a {pattern.cell}: calib finds"
            f" this board on black all the same, other programs may not; smaller {pattern.cell}s or"
            " a larger --paper leave more."
        )
    if isinstance(pattern, CheckerboardPattern) and pattern.looks_the_same_upside_down:
        remarks.append(
            f"A board of {pattern} looks the same upside down, so it must keep the same side up in"
            " all views: one odd and one even number, such as 9x6, leave no doubt."
        )
    return remarks


def _count(text: str) -> int:
    count = whole_number(text)
    if count is None or not 2 <= count <= 1000:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of corners or tags: write a whole number from 2 to"
            " 1000, such as 9"
        )
    return count


def _marker_fraction(text: str) -> float:
    return _number_between(text, 0.3, 0.9, "a marker's part of a square")


def _spacing(text: str) -> float:
    return _number_between(text, *SPACING_LIMITS, "a part of a tag")


def _number_between(text: str, low: float, high: float, kind: str) -> float:
    try:
        fraction = float(text)
    except ValueError:
        fraction = math.nan
    if not low <= fraction <= high:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not {kind}: write a number from {low:g} to {high:g}"
        )
    return fraction


def _parse_papers(text: str) -> "tuple[Paper, ...]":
    from calib.sheet.paper import MAX_PAPER_SIDE, MIN_PAPER_SIDE, PAPERS, parse_paper

    papers = parse_paper(text)
    if papers is None:
        names = ", ".join(paper.name for paper in PAPERS)
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a paper: write {names}, or width x height from"
            f" {MIN_PAPER_SIDE:g} to {MAX_PAPER_SIDE:g} mm, such as 600x400"
        )
    return papers
