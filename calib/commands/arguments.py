"""Arguments that several commands share, each checked as it is read."""

import argparse
import math
from difflib import get_close_matches
from pathlib import Path

from calib.errors import brief
from calib.io.numerals import whole_number

FARTHEST = 1e9
"""m: what is farther is at infinity, to the last digit of a map."""


def depth(text: str) -> float:
    """A distance in metres; `inf` is one."""
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not (0 < metres <= FARTHEST or metres == math.inf):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a depth: write metres above 0, such as 1.0, or inf for the"
            " farthest"
        )
    return metres


def quoted(text: str) -> str:
    """What was typed, as a message repeats it."""
    return repr(brief(text))


def positive(text: str) -> float:
    """A finite number above 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{quoted(text)} will not do: write a number above 0")
    return number


def positive_or_zero(text: str) -> float:
    """A finite number from 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} will not do: write 0, or a number above it"
        )
    return number


def whole_size(text: str) -> tuple[int, int]:
    """Of a board or a picture, such as 9x6."""
    size = two_numbers(text)
    if size is None or min(size) < 3:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a size: write two whole numbers of 3 or more, such as 9x6"
        )
    return size


def two_numbers(text: str) -> tuple[int, int] | None:
    """Return the two whole numbers of a text such as 9x6; None where it is of another form."""
    first, _, second = text.partition("x")
    columns, rows = whole_number(first), whole_number(second)
    return None if columns is None or rows is None else (columns, rows)


def millimetres(text: str) -> float:
    """The side of a square."""
    try:
        side = float(text)
    except ValueError:
        side = 0.0
    if not 0.05 <= side <= 1e5:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a side of a square: write millimetres from 0.05 to 100000, such"
            " as 25"
        )
    return side


def add_depths(parser: argparse.ArgumentParser, *, required: bool) -> None:
    parser.add_argument(
        "--depth",
        type=depth,
        nargs="+",
        action="extend",
        default=[],
        required=required,
        metavar="M",
        help="depth of a map, in metres",
    )


def add_calibration(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "calibration",
        type=Path,
        metavar="CALIBRATION",
        help="calibration.yaml, or the folder that holds it",
    )


def folder_of(calibration: Path) -> Path:
    """Where a calibration lies that is given as its file or as its folder."""
    return calibration if calibration.is_dir() else calibration.parent


def add_output(parser: argparse.ArgumentParser, help_text: str, *, required: bool) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", required=required, help=help_text
    )


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="replace files that calib did not write, or that were changed since",
    )


def calibration_files(calibration: Path) -> tuple[Path, Path]:
    """Return both files of a calibration that is given as its file or as its folder."""
    file = calibration / "calibration.yaml" if calibration.is_dir() else calibration
    return file, file.with_suffix(".npz")


def grid(text: str) -> tuple[int, int] | None:
    """Centres of the relief, such as 12x12; None for `auto`."""
    if text == "auto":
        return None
    centres = two_numbers(text)
    if centres is None or min(centres) < 2 or max(centres) > 64:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a grid: write two whole numbers from 2 to 64, such as 8x8, or"
            " auto"
        )
    return centres


def folds(text: str) -> int:
    count = whole_number(text)
    if count is None or not 2 <= count <= 100:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of folds: write a whole number from 2 to 100, such"
            " as 5"
        )
    return count


def effects(written: str) -> tuple[str, ...]:
    """none, auto, or names of effects, joined by commas."""
    from calib.diagnosis.requested_effects import NAMES

    names = tuple(name for name in written.split(",") if name)
    wrong = [name for name in names if name not in NAMES]
    if written in ("none", "auto"):
        return () if written == "none" else ("auto",)
    if wrong or not names or len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(
            f"{quoted(written)} is not none, auto, or some of {', '.join(NAMES)}, each once, joined"
            " by commas"
        )
    return names


def free(text: str) -> tuple[str, ...]:
    """Names of calib.session.freeing, joined by commas."""
    from calib.session.freeing import NAMES

    for name in text.split(","):
        if name not in NAMES:
            near = get_close_matches(name, NAMES, 1)
            hint = (
                f"did you mean {near[0]}"
                if near
                else f"write some of {', '.join(NAMES)}, joined by commas"
            )
            raise argparse.ArgumentTypeError(
                f"{quoted(name)} is not a number that can be freed: {hint}"
            )
    return tuple(dict.fromkeys(text.split(",")))


def steps(text: str) -> int:
    count = whole_number(text)
    if not count:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of steps: write a whole number above 0, such as 1000"
        )
    return count
