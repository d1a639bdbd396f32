"""Write a board to print: board.pdf and board.svg at true scale, and a session.yaml to start from.

The sheet has two rulers, and says what to measure after printing and where to enter it. Without --square-mm, squares are of the most whole
millimetres that leave a white margin as wide as they are.
"""

import argparse
import sys
from typing import TYPE_CHECKING

from calib.commands.arguments import add_output, millimetres, whole_size
from calib.errors import InputError

if TYPE_CHECKING:
    from calib.sheet.checkerboard import Checkerboard
    from calib.sheet.paper import Paper
    from calib.sheet.sheet import Sheet


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--type", choices=("checkerboard",), default="checkerboard", help="the kind of board")
    parser.add_argument("--columns", type=_count, default=9, metavar="N", help="inner corners along x, by default 9")
    parser.add_argument("--rows", type=_count, default=6, metavar="N", help="inner corners along y, by default 6")
    parser.add_argument("--square-mm", type=millimetres, metavar="S", help="side of a square")
    parser.add_argument(
        "--paper",
        type=_papers,
        default="A4",
        metavar="PAPER",
        help="A4 (the default), A3, Letter, or width x height in mm, such as 600x400",
    )
    size = "of the camera's pictures, for session.yaml; by default 1640x1232, to be corrected there"
    parser.add_argument("--size", type=whole_size, default=(1640, 1232), metavar="WxH", help=size)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_output(parser, "where the files go: the folder of a new session", required=True)


def run(args: argparse.Namespace) -> None:
    from calib.commands.printing import print_json
    from calib.io.files import check_writable, reading, write_atomically
    from calib.sheet.checkerboard import Checkerboard
    from calib.sheet.layout import lay_out
    from calib.sheet.pdf import to_pdf
    from calib.sheet.starting_session import starting_session
    from calib.sheet.svg import to_svg

    session = args.output / "session.yaml"
    with reading(session):
        if session.exists():
            raise InputError(f"{session} is there already, and no session is overwritten: give another folder with -o.")
    pattern = Checkerboard(args.columns, args.rows)
    sheet = lay_out(pattern, args.paper, args.square_mm)
    check_writable(args.output)
    written = (args.output / "board.pdf", args.output / "board.svg", session)
    write_atomically(written[0], to_pdf(sheet))
    write_atomically(written[1], to_svg(sheet))
    write_atomically(session, starting_session(pattern, sheet, args.size))
    if args.json:
        print_json(_as_mapping(args.type, pattern, sheet) | {"written": [str(path) for path in written]})
    else:
        print(*written, sep="\n")
    for remark in _remarks(pattern, sheet):
        print(remark, file=sys.stderr)


def _as_mapping(kind: str, pattern: "Checkerboard", sheet: "Sheet") -> dict[str, object]:
    return {
        "type": kind,
        "board": pattern.to_yaml(sheet.side, sheet.side),
        "paper_mm": [sheet.paper.width, sheet.paper.height],
        "rulers_mm": list(sheet.rulers),
        "corners_mm": [list(corner) for corner in sheet.corners],
    }


def _remarks(pattern: "Checkerboard", sheet: "Sheet") -> list[str]:
    remarks = []
    if sheet.white < sheet.side:
        remarks.append(
            f"The white margin is {sheet.white:.1f} mm, narrower than a square: calib finds this board on black all the same, "
            "other programs may not; smaller squares or a larger --paper leave more."
        )
    if pattern.looks_the_same_upside_down:
        remarks.append(
            f"A board of {pattern} looks the same upside down, so it must keep the same side up in all views: "
            "one odd and one even number, such as 9x6, leave no doubt."
        )
    return remarks


def _count(text: str) -> int:
    if not text.isdecimal() or not 3 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of corners: write a whole number from 3 to 1000, such as 9")
    return int(text)


def _papers(text: str) -> "tuple[Paper, ...]":
    from calib.sheet.paper import LARGEST, PAPERS, SMALLEST, papers

    found = papers(text)
    if found is None:
        names = ", ".join(paper.name for paper in PAPERS)
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a paper: write {names}, or width x height from {SMALLEST:g} to {LARGEST:g} mm, such as 600x400"
        )
    return found
