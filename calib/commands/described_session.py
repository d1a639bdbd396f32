"""The session that `calib fit` calibrates: a session folder, or one that is written for pictures
that the options describe.
"""

import argparse
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import millimetres, whole_size
from calib.commands.board_options import add_coding
from calib.commands.cover_options import (
    add_cover,
    add_intrinsics,
    cover_from_options,
    describe_medium,
    describe_usual,
    given_cover_options,
)
from calib.commands.described_board import board_options, described_board
from calib.commands.earlier_description import (
    camera_section,
    describe_kept_values,
    earlier_document,
    sections_of,
)
from calib.commands.printing import print_remark
from calib.errors import InputError
from calib.io.shell import shell_path
from calib.session.lens import LENSES

if TYPE_CHECKING:
    from calib.importing.named_pictures import NamedPictures
    from calib.progress import Progress
    from calib.session.session import Session

SECTIONS = ("format", "board", "camera", "cover")
"""The keys of session.yaml that options describe, and its version."""
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
    from calib.importing.named_pictures import DESCRIPTION, choose_pictures, find_pictures
    from calib.importing.picture_session import (
        COMMAND,
        Description,
        check_replaceable,
        describe_pictures,
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
    document = earlier_document(source)
    earlier = sections_of(document)
    cover = cover_from_options(args, earlier.get("cover"))
    if cover:
        read_cover(Section({"cover": cover}, COMMAND).section("cover", "{shape: none}"))
    _check_changeable(args, source)
    check_replaceable(source)
    board = None
    if TARGET_KEY in document:
        _check_no_board(args, source)
    else:
        board = described_board(args, source, earlier.get("board"), progress)
    file = source.session / DESCRIPTION
    if board and (width := 1e3 * board.width) < SMALL_BOARD_MM:
        print_remark(SMALL_BOARD.format(board=board, width=width))
    if values := describe_kept_values(args, earlier, cover):
        print_remark(KEPT.format(file=file, values=values))
    elif not (earlier or cover):
        print_remark(NO_COVER)
    if cover:
        for describe_assumption in (describe_usual, describe_medium):
            if sentence := describe_assumption(args, earlier.get("cover")):
                print_remark(sentence)
    description = Description(
        board,
        cover or dict(earlier.get("cover", {"shape": "none"})),
        camera_section(args, earlier),
        {key: value for key, value in document.items() if key not in SECTIONS},
    )
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
        or board_options(args)
    )


def _check_no_board(args: argparse.Namespace, source: "NamedPictures") -> None:
    """Raise InputError if an option describes a board for a target of points."""
    if options := [*(["board"] if args.board else []), *board_options(args)]:
        raise InputError(
            f"{source.session} has a target of points, which is described with its points: leave"
            f" out --{options[0].replace('_', '-')}."
        )


def _check_changeable(args: argparse.Namespace, source: "NamedPictures") -> None:
    """Raise InputError if there is a session.yaml that Refracal did not write, or that has changed
    since: options do not change it.
    """
    from calib.importing.named_pictures import DESCRIPTION
    from calib.io.output_folder import OutputFolder

    file = source.session / DESCRIPTION
    if not file.is_file() or file.is_symlink() or OutputFolder(source.session).owns(DESCRIPTION):
        return
    by_section = {
        "board": [*(["board"] if args.board else []), *board_options(args)],
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


def _is_session(path: Path) -> bool:
    from calib.io.files import reading

    with reading(path):
        return (path / "session.yaml").exists()
