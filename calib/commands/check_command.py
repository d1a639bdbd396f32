"""The command `calib check`."""

import argparse
from pathlib import Path

from calib.commands.arguments import (
    add_calibration,
    add_output,
    add_overwrite,
    calibration_files,
    check_order,
    folder_of,
)
from calib.commands.loading import fast_imports

SUMMARY = "Check with a few pictures whether a calibration still holds, and find what changed."
DESCRIPTION = """
PICTURES are a session, a folder of pictures, or picture files. Three to five are enough: tilt the
board, and show it near and far. If they have no session.yaml, the board is the calibration's.
Exit code 0: valid; 5: degraded or broken.

With --update, the command also writes an updated calibration: the old one is the prior, and the
pictures refine it. Its history is kept.
"""
EXAMPLES = (
    "calib check cam0/calibration today/*.jpg",
    "calib check cam0/calibration today --update",
)

NOT_VALID = 5
"""The exit code of a calibration that is degraded or broken."""


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
        help="write a calibration that these pictures refine",
    )
    add_output(
        parser,
        "folder for the updated calibration (default: updated/ beside CALIBRATION)",
        required=False,
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    with fast_imports():
        from calib.calibration import Calibration
        from calib.calibration_file import DERIVED, FILES
        from calib.checking.check import Checker
        from calib.checking.pictures import read_pictures
        from calib.checking.result import CheckStatus
        from calib.checking.update import NumberUpdate, update
        from calib.commands.check_lines import next_command, print_result, with_own_verdict
        from calib.commands.console import Bars
        from calib.commands.printing import print_json
        from calib.errors import InputError
        from calib.io.file_set import FileSet
        from calib.io.output_folder import OutputFolder, check_no_link
        from calib.io.patterns import expand

    if args.output and not args.update:
        raise InputError(
            "-o says where an updated calibration goes: write --update with it, or leave it out."
        )
    args.pictures = expand(args.pictures)
    check_order(args.calibration, args.pictures)
    calibration = Calibration.load(args.calibration)
    if args.update:
        output = args.output or check_no_link(folder_of(args.calibration) / "updated")
        inputs = calibration_files(args.calibration)
        OutputFolder(output, overwrite=args.overwrite, inputs=inputs).check(FILES)
    with Bars() as bars:
        pictures = read_pictures(args.pictures, calibration, bars)
        checker = Checker.of(calibration)
        result = with_own_verdict(checker.check(pictures, bars), calibration)
    numbers: tuple[NumberUpdate, ...] = ()
    written: list[Path] = []
    if args.update:
        updated, numbers = update(calibration, checker.prior, result, pictures)
        with FileSet(output, overwrite=args.overwrite, inputs=inputs) as files:
            written = [updated.write(files)]
            files.commit(instead_of=DERIVED)
    following = next_command(
        result,
        written[0].parent if written else args.calibration,
        args.pictures,
        updated=bool(written),
        size=(calibration.camera.width, calibration.camera.height),
    )
    if args.json:
        updates = {number.name: number.as_json() for number in numbers}
        print_json(
            result.as_json()
            | ({"moved": updates} if args.update else {})
            | {
                "next": following,
                "written": [str(path) for path in written],
            }
        )
    else:
        print_result(result, numbers, written, following)
    return 0 if result.status is CheckStatus.VALID else NOT_VALID
