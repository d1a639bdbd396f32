"""The board of pictures: as the options describe it, as an earlier session.yaml has it, or as the
pictures show it.
"""

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.board_options import OPTIONS, board_from_options
from calib.commands.printing import print_remark
from calib.errors import InputError
from calib.io.numerals import counted

if TYPE_CHECKING:
    from calib.corners.board_search import FoundBoard
    from calib.importing.named_pictures import NamedPictures
    from calib.progress import Progress
    from calib.session.board import Board

SEARCHED_PICTURES = 8
"""Pictures, spread over all of them, in which a board is looked for."""
NUMBERED_PICTURES = 4
"""Pictures, spread over all of them, whose markers are compared with the described board's."""
NEEDED = {
    "charuco": ("marker_mm", "dictionary"),
    "aprilgrid": ("spacing",),
    "gridboard": ("spacing", "dictionary"),
}
"""The options of each type that the pictures tell where they are not given."""
UNKNOWN_SIDE = {
    "square": "Pictures cannot show how large its squares are",
    "tag": "Pictures cannot show how large its tags are",
}


def described_board(
    args: argparse.Namespace,
    source: "NamedPictures",
    earlier: "dict[str, object] | None",
    progress: "Progress",
) -> "Board":
    """Return the board that the options describe. If they lack its corners or its size, the rest is
    as in `earlier`, the section of the session.yaml that is to be replaced; else as the pictures
    have it.
    """
    from calib.session.board_section import read_board
    from calib.session.schema import Section

    options = board_options(args)
    kind = str((earlier or {}).get("type", "checkerboard"))
    is_complete = args.board and options.keys() & {"square_mm", "tag_mm"}
    if earlier and not is_complete and options.get("type", kind) == kind:
        size = dict(zip(("columns", "rows"), args.board or (), strict=False))
        return read_board(Section({**earlier, **size, **options}, "The command line"))
    find = _declared_board if args.board else _find_board
    return find(args, source, progress)


def board_options(args: argparse.Namespace) -> dict[str, object]:
    """Return the given options of the board but --board itself, by their names in session.yaml."""
    return {key: value for key in OPTIONS if (value := getattr(args, key)) is not None}


def _declared_board(
    args: argparse.Namespace, source: "NamedPictures", progress: "Progress"
) -> "Board":
    """Return the board that the options describe. Where they leave open how its markers are
    numbered and printed, the pictures say it.
    """
    from calib.corners.board_search import shrink
    from calib.corners.other_coding import find_other_numbering
    from calib.importing.named_pictures import sample

    options = board_options(args)
    if any(key not in options for key in NEEDED.get(str(options.get("type")), ())):
        return _find_board(args, source, progress)
    board = board_from_options(args)
    assert board
    if board.coding is None:
        return board
    advance = progress.task("Looking at the markers", 1)
    other = find_other_numbering(shrink(sample(source, NUMBERED_PICTURES, progress)), board)
    advance(1, "")
    if other is None or other.changes.keys() & options.keys():
        return board
    print_remark(f"{other.finding}: session.yaml has {other.keys}.")
    return other.board


def _words_without_board(args: argparse.Namespace) -> list[str]:
    """Return the options that were typed, without those of the board and of the pictures."""
    left_out = {"--board", "--camera", *(f"--{key.replace('_', '-')}" for key in OPTIONS)}
    words: list[str] = []
    is_left_out = False
    for word in args.words[1:]:
        if word.startswith("-") and not word[1:2].isdigit():
            is_left_out = word.partition("=")[0] in left_out
        if not is_left_out and Path(word) not in args.session:
            words.append(word)
    return words


def describe_search(finding: "FoundBoard", count: int | None) -> str:
    """Return how many of the searched pictures show the board, of `count` pictures, in words; None:
    they are frames of a video.
    """
    searched = finding.searched
    if count is None:
        return f"{finding.pictures} of {counted(searched, 'frame')}"
    if searched == count:
        return f"{finding.pictures} of {counted(searched, 'picture')}"
    shown = (
        f"all {counted(searched, 'picture')}"
        if finding.pictures == searched > 1
        else f"{finding.pictures} of the {counted(searched, 'picture')}"
    )
    return f"{shown} that {'was' if searched == 1 else 'were'} searched (there are {count})"


def _find_board(args: argparse.Namespace, source: "NamedPictures", progress: "Progress") -> "Board":
    """Look for a board in the pictures, and return it with what the options state.

    Raises:
        InputError: there is none, it is another than the options state, or its size in mm is
            missing.
    """
    from calib.corners.board_search import search_board
    from calib.importing.named_pictures import EXAMPLE, sample
    from calib.session.board_section import read_board
    from calib.session.schema import Section

    pictures = sample(source, SEARCHED_PICTURES, progress)
    advance = progress.task("Looking for a board", 1)
    finding = search_board(pictures)
    advance(1, "")
    options = board_options(args)
    if finding is None:
        markers = " and ".join(
            f"--{key.replace('_', '-')}" for key in NEEDED.get(str(options.get("type")), ())
        )
        raise InputError(
            f"{source.words} has no session.yaml, and no board was found in"
            f" {counted(len(pictures), 'picture')} of it: "
            + (
                f"add {markers} to the command, or look at the pictures."
                if markers
                else f"describe it by `calib fit {source.words} {EXAMPLE}` (inner corners), with"
                " --type where it has markers."
            )
        )
    count = None if source.video else len(source.pictures)
    sentence = f"{finding.sentence} in {describe_search(finding, count)}."
    if reason := _missing_or_wrong(args, finding):
        raise InputError(f"{sentence} {reason} `{_complete_command(args, source, finding)}`.")
    print_remark(sentence)
    scale = float(str(options[finding.side_key]))
    return read_board(Section({**finding.to_yaml(scale), **options}, "The command line"))


def _missing_or_wrong(args: argparse.Namespace, finding: "FoundBoard") -> str:
    """Return why the options do not describe the board in the pictures, as the beginning of a
    sentence that ends with the right command; empty if they do.
    """
    options = board_options(args)
    kind = options.get("type", finding.kind)
    is_other_size = args.board not in (None, finding.size)
    has_spacing = "spacing" in options or not finding.is_vague
    if finding.side_key in options and kind == finding.kind and not is_other_size and has_spacing:
        return ""
    if is_other_size:
        return "--board says {}x{}: type".format(*args.board)
    if kind != finding.kind:
        return f"--type says {kind}: type"
    cell = finding.board.cell
    if _side_of_other_kind(finding) in options:
        return f"The side of a {cell} is --{cell}-mm: type"
    return f"{UNKNOWN_SIDE[cell]}: measure one, and type"


def _complete_command(
    args: argparse.Namespace, source: "NamedPictures", finding: "FoundBoard"
) -> str:
    """Return the command with the options that describe the board in the pictures."""
    options = board_options(args)
    side = options.get(finding.side_key, options.get(_side_of_other_kind(finding)))
    board = finding.options_for(float(str(side)) if side else None)
    other_words = shlex.join(_words_without_board(args))
    return " ".join(filter(None, ("calib fit", source.words, other_words, board)))


def _side_of_other_kind(finding: "FoundBoard") -> str:
    """Return the key of the side that this kind of board does not have."""
    return "square_mm" if finding.side_key == "tag_mm" else "tag_mm"
