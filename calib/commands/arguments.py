"""Arguments that several commands share, each checked as it is read."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from calib.errors import InputError, brief, meant
from calib.io.numerals import whole_number
from calib.io.result_names import CALIBRATION_FILE
from calib.session.number_spelling import length_in_mm, material_index
from calib.session.schema import is_unknown

FARTHEST = 1e9
"""m: a map for a greater depth equals the map for infinity to its last digit."""
DOUBTED_MM = 1.0
"""mm: a tag or square with a smaller side is hardly ever printed."""
Options = argparse.ArgumentParser | argparse._ArgumentGroup
"""A parser, or a group of options in its help."""


def depth(text: str) -> float:
    """Return a distance in metres; `inf` is allowed."""
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not (0 < metres <= FARTHEST or metres == math.inf):
        if length := length_in_mm(text):
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} is not a depth: write {length / 1000:g}, in metres without a unit"
            )
        if "," in text:
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} is not a depth: write metres with a point, such as 0.8, and"
                " several depths with blanks between them"
            )
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a depth: write metres above 0, such as 1.0, or inf for the"
            " farthest"
        )
    return metres


def finite_depth(text: str) -> float:
    """Return a finite distance in metres."""
    metres = depth(text)
    if metres == math.inf:
        raise argparse.ArgumentTypeError(
            "a pair is aligned at a finite depth: write metres, such as 1000 for the farthest"
        )
    return metres


def quoted(text: str) -> str:
    """Return the text as a message quotes it: in quotation marks, and cut if it is long."""
    return repr(brief(text))


def refuse_material(text: str) -> None:
    """Refuse the name of a material, such as water, where a number has to stand."""
    if index := material_index(text):
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number: write {index:g}, its refractive index"
        )


def positive_number(text: str) -> float:
    """Return a finite number above 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number above 0: write one, such as 0.5"
        )
    return number


def positive_or_zero(text: str) -> float:
    """Return a finite number of 0 or more."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of 0 or more: write one, such as 0 or 0.5"
        )
    return number


def whole_size(text: str) -> tuple[int, int]:
    """Return the size of a board or a picture, such as 9x6: columns and rows, or width and
    height.
    """
    size = two_numbers(text)
    if size is None or min(size) < 3:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a size: write two whole numbers of 3 or more, such as 9x6"
        )
    return size


def two_numbers(text: str) -> tuple[int, int] | None:
    """Return the two whole numbers of a text such as 9x6, 9X6 or 9 × 6; None if it has another
    form.
    """
    first, _, second = text.lower().replace("×", "x").partition("x")
    columns = whole_number(first.strip())
    rows = whole_number(second.strip())
    return None if columns is None or rows is None else (columns, rows)


def millimetres(text: str) -> float:
    """Return the side of a square in mm."""
    try:
        side = float(text)
    except ValueError:
        side = 0.0
    if not 0.05 <= side <= 1e5:
        if length := length_in_mm(text):
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} is not a side of a square: write {length:g}, in millimetres"
                " without a unit"
            )
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a side of a square: write millimetres from 0.05 to 100000, such"
            f" as 25{_side_hint(text, side)}"
        )
    return side


def check_depth_given(args: argparse.Namespace) -> None:
    """Raise InputError if there is neither a depth nor a depth image."""
    if args.depth is None and args.depth_image is None:
        raise InputError(
            "No depth is given: write --depth 0.8 for one distance in metres, or"
            " --depth-image FILE for a distance of each pixel."
        )


def _side_hint(text: str, side: float) -> str:
    """Return what was probably meant by a text that is no side of a square; "" if nothing shows it.

    Args:
        text: what was typed.
        side: its number, 0 if it is none.
    """
    if 0 < side < 0.05:
        return f" ({side:g} m, if metres were meant, is {side * 1000:g})"
    if is_unknown(text):
        return ". Pictures cannot show it: measure ten squares, and divide"
    if "+-" in text:
        return ". An uncertainty stands in session.yaml: square_mm: {value: 25, sigma: 0.5}"
    return ""


def doubt_unit(option: str, side_mm: float) -> str:
    """Return a warning about a printed side, mm, that may be in metres; "" if it is plausible."""
    if side_mm >= DOUBTED_MM:
        return ""
    return (
        f"Take care: {option} {side_mm:g} is in millimetres, and hardly any printer draws that. If"
        f" metres were meant, write {side_mm * 1000:g}."
    )


def add_depths(parser: Options, *, required: bool) -> None:
    parser.add_argument(
        "--depth",
        type=depth,
        nargs="+",
        action="extend",
        default=[],
        required=required,
        metavar="METRES",
        help="distance of the scene that a map is for",
    )


def add_calibration(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "calibration",
        type=Path,
        metavar="CALIBRATION",
        help="calibration.yaml, or the folder that holds it",
    )


def folder_of(calibration: Path) -> Path:
    """Return the folder of a calibration that is given as its file or as its folder."""
    return calibration if calibration.is_dir() else calibration.parent


def add_camera(parser: Options) -> None:
    parser.add_argument(
        "--camera",
        metavar="NAME",
        help="which camera, if the pictures' names or EXIF show several; all: they are one camera",
    )


def add_output(parser: Options, help_text: str, *, required: bool) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", required=required, help=help_text
    )


def add_overwrite(parser: Options) -> None:
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="replace files that calib did not write, or that were changed since",
    )


def calibration_files(calibration: Path) -> tuple[Path, Path]:
    """Return both files of a calibration that is given as its file or as its folder."""
    file = calibration / CALIBRATION_FILE if calibration.is_dir() else calibration
    return file, file.with_suffix(".npz")


def check_order(calibration: Path, pictures: Sequence[Path]) -> None:
    """Raise InputError if a calibration is given among the pictures, and pictures in its place."""

    def is_calibration(path: Path) -> bool:
        file, _ = calibration_files(path)
        return file.suffix == ".yaml" and file.is_file()

    if not is_calibration(calibration):
        for path in filter(is_calibration, pictures):
            raise InputError(f"{path} is the calibration, not {calibration}: give it first.")


def grid(text: str) -> tuple[int, int] | None:
    """Return the numbers of the relief's centres, such as 12x12; None for `auto`; (1, 1) for even
    glass.
    """
    if text == "auto":
        return None
    centres = two_numbers(text)
    if centres == (1, 1):
        return centres
    if centres is None or min(centres) < 2 or max(centres) > 64:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a grid: write two whole numbers from 2 to 64, such as 8x8, or"
            " auto, or 1x1 for even glass"
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


def effects(text: str) -> tuple[str, ...]:
    """Return the names of effects that commas join; none for `none`, and ("auto",) for `auto`."""
    from calib.diagnosis.requested_effects import NAMES

    names = tuple(name for name in text.split(",") if name)
    invalid = [name for name in names if name not in NAMES]
    if text in ("none", "auto"):
        return () if text == "none" else ("auto",)
    if invalid or not names or len(set(names)) < len(names):
        near = meant(invalid[0], NAMES) if invalid else ""
        hint = f": did you mean {near}?" if near else "."
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} does not name effects{hint} Write none, auto, or some of"
            f" {', '.join(NAMES)}, each once, joined by commas"
        )
    return names


def free(text: str) -> tuple[str, ...]:
    """Return the names of calib.session.freeing that commas join, each once."""
    from calib.session.freeing import NONE, option_names

    names = option_names()
    chosen = tuple(dict.fromkeys(text.split(",")))
    for name in chosen:
        if name not in names:
            near = meant(name, names)
            hint = f": did you mean {near}?" if near else "."
            raise argparse.ArgumentTypeError(
                f"{quoted(name)} is not a number that can be freed{hint} Write some of"
                f" {', '.join(names)}, joined by commas"
            )
    if NONE in chosen and len(chosen) > 1:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} frees numbers and {NONE} of them: write {NONE} alone, or leave it out"
        )
    return chosen


def steps(text: str) -> int:
    count = whole_number(text)
    if not count:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of steps: write a whole number above 0, such as 1000"
        )
    return count


def add_crop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--crop",
        type=crop_alpha,
        metavar="ALPHA",
        help=(
            "0: only valid pixels; 1: everything that the camera sees (default: no zoom, with black"
            " borders where there are no pixels)"
        ),
    )


def crop_alpha(text: str) -> float:
    try:
        alpha = float(text)
    except ValueError:
        alpha = -1.0
    if not 0 <= alpha <= 1:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not from 0 to 1: write 0 for valid pixels only, 1 for all that the"
            " camera sees"
        )
    return alpha
