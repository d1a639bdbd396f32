"""Ask a few pictures of the board whether a calibration still holds, and if not, what has changed.

PICTURES are a session, a folder of pictures or picture files, three to five of them, the board tilted, near and far. Without a session.yaml
of their own, their board is the calibration's. Exit code 0: valid; 5: degraded or broken.
"""

import argparse
from pathlib import Path

from calib.commands.arguments import add_calibration

NOT_VALID = 5
"""The exit code."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument("pictures", type=Path, nargs="+", metavar="PICTURES", help="a session, a folder of pictures, or picture files")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    from calib.calibration import Calibration
    from calib.checking.answer import Word
    from calib.checking.check import Checker
    from calib.checking.pictures import read_pictures
    from calib.commands.check_lines import next_command, print_answer
    from calib.commands.console import Bars
    from calib.commands.printing import print_json

    calibration = Calibration.load(args.calibration)
    with Bars() as bars:
        pictures = read_pictures(args.pictures, calibration, bars)
        answer = Checker.of(calibration).check(pictures, bars)
    following = next_command(answer, args.calibration, args.pictures)
    if args.json:
        print_json(answer.as_json() | {"next": following, "written": []})
    else:
        print_answer(answer, following)
    return 0 if answer.word is Word.VALID else NOT_VALID
