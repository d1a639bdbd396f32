"""The session that `calib fit` calibrates: a session folder, or one that is written for pictures
that the options describe.
"""

import argparse
import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import millimetres, whole_size
from calib.commands.board_options import OPTIONS, add_coding, board_from_options
from calib.commands.cover_options import (
    add_cover,
    add_intrinsics,
    cover_from_options,
    describe_medium,
    describe_usual,
    given_cover_options,
    intrinsics_from_options,
)
from calib.commands.printing import print_remark
from calib.errors import InputError
from calib.io.numerals import counted
from calib.io.shell import shell_path
from calib.session.lens import AUTO, LENSES, OPENCV

if TYPE_CHECKING:
    from calib.corners.board_search import FoundBoard
    from calib.importing.picture_session import NamedPictures
    from calib.progress import Progress
    from calib.session.board import Board
    from calib.session.session import Session

SECTIONS = ("format", "board", "camera", "cover")
"""The keys of session.yaml that options describe, and its version."""
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
KEPT = (
    "{file} still holds what an earlier command said: {values}. An option changes it; to"
    " start anew, delete the file."
)
"""The remark on pictures that were described before."""
NO_COVER = (
    "no --cover: the camera is taken as bare. Behind glass or plastic add --cover cone,"
    " cylinder, flat, dome or unknown."
)
"""The remark on pictures that are described without a cover."""

COMMON = {
    "--board": "the board's inner corners, such as 9x6",
    "--square-mm": "side of a square",
    "--type": "checkerboard, charuco, aprilgrid, gridboard",
    "--cover": "none, cone, cylinder, flat, dome, unknown",
    "--radius": "inner radius; 40+-5 is 40 with a sigma of 5",
    "--distance": "window: from the lens to its inner face",
    "--thickness": "thickness of the glass",
    "--index": "glass 1.52, acrylic 1.49 (default: 1.5+-0.02)",
    "--outside-index": "air 1, water 1.333",
    "--intrinsics": "the lens, or the file that OpenCV wrote",
    "--lens": "opencv, fisheye, splined, auto",
}
"""The options on board, cover and camera that most people need, in a few words."""
SMALL_BOARD_MM = 40.0
"""The width below which the unit is doubted: boards of centimetres are 40 mm and more."""
SMALL_BOARD = (
    "the {board} board is {width:.3g} mm wide. If its sides are in centimetres, write millimetres."
)


def add_description(
    parser: argparse.ArgumentParser, purpose: str, board_default: str = ""
) -> argparse._ArgumentGroup:
    """Add the options that describe the board, the cover and the lens of pictures, and return the
    group of those on the camera.

    Args:
        purpose: what they are for, as the first words below their headings.
        board_default: what happens without --board, behind its help.
    """
    board = parser.add_argument_group("board", purpose)
    board.add_argument(
        "--board",
        type=whole_size,
        metavar="COLSxROWS",
        help=f"inner corners, columns x rows, or a grid's tags{board_default}",
    )
    board.add_argument("--square-mm", type=millimetres, metavar="MM", help="side of a square")
    cover = parser.add_argument_group(
        "cover", f"{purpose}; 40+-5 is 40 with a sigma (standard deviation) of 5"
    )
    add_cover(cover)
    camera = parser.add_argument_group("camera")
    add_intrinsics(camera)
    camera.add_argument(
        "--lens",
        choices=LENSES,
        help="the lens model: opencv for usual lenses, fisheye for wide ones, splined for lenses"
        " that no formula describes, auto for the best of them (default: opencv, or fisheye for a"
        " wide lens that asks for it)",
    )
    add_coding(board, parser.add_argument_group("board with markers or tags"))
    return camera


@dataclass(frozen=True, slots=True)
class DescribedSession:
    """A session, and what its description was before the command."""

    session: "Session"
    earlier: bytes | None = None
    """The session.yaml that the options replaced; None if they replaced none."""
    file: Path | None = None
    """The session.yaml that the command wrote; None if it wrote none."""


def session_of(args: argparse.Namespace, progress: "Progress") -> DescribedSession:
    """Return the session that the arguments name. For pictures without one, it is written.

    Raises:
        InputError: the pictures need a description; the message has the command that gives it.
    """
    from calib.importing.picture_session import (
        COMMAND,
        DESCRIPTION,
        Description,
        check_replaceable,
        choose_pictures,
        describe_pictures,
        find_pictures,
    )
    from calib.io.files import read_file, reading
    from calib.session.cover_section import read_cover
    from calib.session.schema import Section
    from calib.session.session import TARGET_KEY, read_session

    is_described = has_description(args)
    if len(args.session) == 1 and not is_described and _is_session(args.session[0]):
        return DescribedSession(read_session(args.session[0]))
    source = find_pictures(args.session)
    if source.is_described and not is_described:
        return DescribedSession(read_session(source.session))
    source = _in_writable_folder(choose_pictures(source, args.camera), args.output)
    document = _earlier_document(source)
    earlier = _sections(document)
    cover = cover_from_options(args, earlier.get("cover"))
    if cover:
        read_cover(Section({"cover": cover}, COMMAND).section("cover", "{shape: none}"))
    _check_changeable(args, source)
    check_replaceable(source)
    board = None
    if TARGET_KEY in document:
        _check_no_board(args, source)
    else:
        board = _board_of(args, source, earlier.get("board"), progress)
    if board and (width := 1e3 * board.width) < SMALL_BOARD_MM:
        print_remark(SMALL_BOARD.format(board=board, width=width))
    if values := _earlier_values(args, earlier, cover):
        file = source.session / "session.yaml"
        print_remark(KEPT.format(file=file, values=values))
    elif not (earlier or cover):
        print_remark(NO_COVER)
    assumed = (f(args, earlier.get("cover")) for f in (describe_usual, describe_medium))
    for sentence in filter(None, assumed if cover else ()):
        print_remark(sentence)
    cover = cover or dict(earlier.get("cover", {"shape": "none"}))
    further = {key: value for key, value in document.items() if key not in SECTIONS}
    description = Description(board, cover, _camera_of(args, earlier), further)
    file = source.session / DESCRIPTION
    with reading(file):  # another fit may have written it in the meantime
        replaced = read_file(file) if file.is_file() else None
    for notice in describe_pictures(source, description, progress):
        print_remark(notice)
    return DescribedSession(read_session(source.session), replaced, file)


def has_description(args: argparse.Namespace) -> bool:
    """True if the options describe pictures, so that a session.yaml is written for them."""
    return bool(
        given_cover_options(args)
        or args.intrinsics
        or args.lens
        or args.board
        or args.camera
        or _board_options(args)
    )


def _check_no_board(args: argparse.Namespace, source: "NamedPictures") -> None:
    if options := [*(["board"] if args.board else []), *_board_options(args)]:
        raise InputError(
            f"{source.session} has a target of points, which is described with its points: leave"
            f" out --{options[0].replace('_', '-')}."
        )


def _check_changeable(args: argparse.Namespace, source: "NamedPictures") -> None:
    """Raise InputError if there is a session.yaml that Refracal did not write, or that has changed
    since: options do not change it.
    """
    from calib.importing.picture_session import DESCRIPTION
    from calib.io.output_folder import OutputFolder

    file = source.session / DESCRIPTION
    if not file.is_file() or file.is_symlink() or OutputFolder(source.session).owns(DESCRIPTION):
        return
    by_section = {
        "board": [*(["board"] if args.board else []), *_board_options(args)],
        "cover": given_cover_options(args),
        "camera": [name for name in ("intrinsics", "lens") if getattr(args, name)],
    }
    options = [name for names in by_section.values() for name in names]
    *first, last = [f"--{name.replace('_', '-')}" for name in options] or ["--camera"]
    sections = " and ".join(name for name, names in by_section.items() if names)
    set_there = f"set {sections} there, or " if sections else ""
    raise InputError(
        f"{file} is yours (Refracal did not write it, or it has changed since), so options do not"
        f" change it: {set_there}leave out {', '.join(first)}{' and ' * bool(first)}{last}."
    )


def _earlier_values(
    args: argparse.Namespace,
    earlier: dict[str, dict[str, object]],
    cover: dict[str, object] | None,
) -> str:
    """Return what the options take over from an earlier description: the board, the lens, and the
    keys of the cover with their values.

    Args:
        cover: the section `cover` by the options and the earlier description; None: no option
            describes it, and the earlier one stays.
    """
    old = earlier.get("cover", {})
    new = (cover_from_options(args, {"shape": cover["shape"]}) if cover else None) or {}
    new["shape"] = args.cover
    numbers = {
        key: value
        for key, value in (old if cover is None else cover).items()
        if key in old and new.get(key) != value
    }
    board = earlier.get("board", {})
    size = f" {board['columns']}x{board['rows']}" if {"columns", "rows"} <= board.keys() else ""
    side = _earlier_side(board)
    texts = {
        f"the board{size}": bool(board) and not (args.board or _board_options(args)),
        side: bool(side) and not _board_options(args),
        ", ".join(f"{key} {_in_words(value)}" for key, value in numbers.items()): bool(numbers),
        "the lens": "intrinsics" in earlier and not args.intrinsics,
        f"the lens model {_lens_of(earlier)}": bool(_lens_of(earlier)) and not args.lens,
    }
    return ", ".join(text for text, is_earlier in texts.items() if text and is_earlier)


def _earlier_side(board: dict[str, object]) -> str:
    """Return the size of an earlier board's squares or tags in words; empty without one."""
    sides = [f"{key} {_in_words(board[key])}" for key in ("square_mm", "tag_mm") if key in board]
    return sides[0] if sides else ""


def _in_words(value: object) -> str:
    """Return a value of session.yaml in words, such as 1.333 ± 0.004."""
    if isinstance(value, dict) and "value" in value:
        sigma = f" ± {value['sigma']:g}" if "sigma" in value else ""
        return f"{_in_words(value['value'])}{sigma}"
    if isinstance(value, list):
        return f"({', '.join(map(_in_words, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _in_writable_folder(source: "NamedPictures", output: Path | None) -> "NamedPictures":
    """Return the source with the folder `output` as its session, if its own cannot be written."""
    folder = source.session
    place = folder if folder.exists() else folder.parent
    if os.access(place, os.W_OK):
        return source
    if output is None:
        raise InputError(
            f"{place} cannot be written: name a folder for the session and its calibration by -o,"
            f" such as -o {shell_path(f'{folder.name}-session')}"
        )
    return replace(source, session=output)


def _earlier_document(source: "NamedPictures") -> dict[str, object]:
    """Return the session.yaml that is to be replaced; empty if there is none."""
    from calib.importing.picture_session import DESCRIPTION
    from calib.io.yaml_reader import read_yaml

    return dict(read_yaml(source.session / DESCRIPTION)) if source.is_described else {}


def _sections(document: Mapping[str, object]) -> dict[str, dict[str, object]]:
    """Return the sections board, cover, camera and its intrinsics of a session.yaml, those that are
    mappings. Intrinsics are left out if they are unknown.
    """
    camera = document.get("camera")
    sections = {
        "board": document.get("board"),
        "cover": document.get("cover"),
        "camera": camera,
        "intrinsics": camera.get("intrinsics") if isinstance(camera, dict) else None,
    }
    return {name: value for name, value in sections.items() if isinstance(value, dict)}


def _camera_of(
    args: argparse.Namespace, earlier: dict[str, dict[str, object]]
) -> dict[str, object]:
    """Return the section `camera`: what the options say, and else what it said earlier."""
    camera = dict(earlier.get("camera", {}))
    if args.lens:
        camera["lens"] = args.lens
        if args.lens not in (OPENCV, AUTO):
            camera.pop("lens_coefficients", None)
    camera.pop("intrinsics", None)
    intrinsics = intrinsics_from_options(args) or earlier.get("intrinsics")
    return camera | ({"intrinsics": intrinsics} if intrinsics else {})


def _lens_of(earlier: dict[str, dict[str, object]]) -> str:
    """Return the lens model of an earlier description; "" if it states none."""
    lens = earlier.get("camera", {}).get("lens")
    return lens if isinstance(lens, str) else ""


def _board_of(
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

    options = _board_options(args)
    kind = str((earlier or {}).get("type", "checkerboard"))
    is_complete = args.board and options.keys() & {"square_mm", "tag_mm"}
    if earlier and not is_complete and options.get("type", kind) == kind:
        size = dict(zip(("columns", "rows"), args.board or (), strict=False))
        return read_board(Section({**earlier, **size, **options}, "The command line"))
    find = _declared_board if args.board else _find_board
    return find(args, source, progress)


def _is_session(path: Path) -> bool:
    from calib.io.files import reading

    with reading(path):
        return (path / "session.yaml").exists()


def _board_options(args: argparse.Namespace) -> dict[str, object]:
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
    from calib.importing.picture_session import sample

    options = _board_options(args)
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
    from calib.importing.picture_session import EXAMPLE, sample
    from calib.session.board_section import read_board
    from calib.session.schema import Section

    pictures = sample(source, SEARCHED_PICTURES, progress)
    advance = progress.task("Looking for a board", 1)
    finding = search_board(pictures)
    advance(1, "")
    options = _board_options(args)
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
    kind = str(options.get("type", finding.kind))
    count = None if source.video else len(source.pictures)
    side = finding.side_key
    sentence = f"{finding.sentence} in {describe_search(finding, count)}."
    if (
        side not in options
        or kind != finding.kind
        or args.board not in (None, finding.size)
        or ("spacing" not in options and finding.is_vague)
    ):
        kept = shlex.join(_words_without_board(args))
        mistaken = options.get("square_mm" if side == "tag_mm" else "tag_mm")
        typed = options.get(side, mistaken)
        described = finding.options_for(float(str(typed)) if typed else None)
        command = " ".join(filter(None, ("calib fit", source.words, kept, described)))
        if args.board not in (None, finding.size):
            reason = "--board says {}x{}: type".format(*args.board)
        elif kind != finding.kind:
            reason = f"--type says {kind}: type"
        elif mistaken:
            cell = finding.board.cell
            reason = f"The side of a {cell} is --{cell}-mm: type"
        else:
            reason = f"{UNKNOWN_SIDE[finding.board.cell]}: measure one, and type"
        raise InputError(f"{sentence} {reason} `{command}`.")
    print_remark(sentence)
    scale = float(str(options[side]))
    return read_board(Section({**finding.to_yaml(scale), **options}, "The command line"))
