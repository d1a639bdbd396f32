"""Ask a few pictures of the board whether a calibration still holds, and if not, what has changed.

PICTURES are a session, a folder of pictures or picture files, three to five of them, the board
tilted, near and far. Without a session.yaml of their own, their board is the calibration's. Exit
code 0: valid; 5: degraded or broken.

With --update, OUT gets the calibration brought up to date: refitted to the pictures with all that
it knew as the prior, its history kept.
"""

import argparse
from pathlib import Path

from calib.commands.arguments import (
    add_calibration,
    add_output,
    add_overwrite,
    calibration_files,
    folder_of,
)
from calib.commands.loading import quickly

NOT_VALID = 5
"""The exit code."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "pictures",
        type=Path,
        nargs="+",
        metavar="PICTURES",
        help="a session, a folder of pictures, or picture files",
    )
    parser.add_argument(
        "--update",
        action="store_true",
        help="write the calibration brought up to date by these pictures",
    )
    add_output(
        parser, "where the updated calibration goes (default: updated/ beside it)", required=False
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    with quickly():
        from calib.calibration import DERIVED, FILES, Calibration
        from calib.checking.answer import Word
        from calib.checking.check import Checker
        from calib.checking.pictures import read_pictures
        from calib.checking.update import Moved, update
        from calib.commands.check_lines import next_command, print_answer
        from calib.commands.console import Bars
        from calib.commands.printing import print_json
        from calib.errors import InputError
        from calib.io.file_set import FileSet
        from calib.io.output_folder import OutputFolder, check_no_link

    if args.output and not args.update:
        raise InputError(
            "-o says where an updated calibration goes: write --update with it, or leave it out."
        )
    calibration = Calibration.load(args.calibration)
    if args.update:
        output = args.output or check_no_link(folder_of(args.calibration) / "updated")
        inputs = calibration_files(args.calibration)
        OutputFolder(output, overwrite=args.overwrite, inputs=inputs).check(FILES)
    with Bars() as bars:
        pictures = read_pictures(args.pictures, calibration, bars)
        checker = Checker.of(calibration)
        answer = checker.check(pictures, bars)
    moved: tuple[Moved, ...] = ()
    written: list[Path] = []
    if args.update:
        updated, moved = update(calibration, checker.known, answer, pictures)
        with FileSet(output, overwrite=args.overwrite, inputs=inputs) as files:
            written = [updated.write(files)]
            files.commit(instead_of=DERIVED)
    following = next_command(
        answer,
        written[0].parent if written else args.calibration,
        args.pictures,
        updated=bool(written),
    )
    if args.json:
        told = {"moved": {one.name: one.as_json() for one in moved}} if args.update else {}
        print_json(
            answer.as_json()
            | told
            | {
                "next": following,
                "written": [str(path) for path in written],
            }
        )
    else:
        print_answer(answer, moved, written, following)
    return 0 if answer.word is Word.VALID else NOT_VALID
