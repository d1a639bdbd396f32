"""The command `calib init`."""

import argparse
from pathlib import Path

from calib.commands.arguments import add_overwrite, whole_size
from calib.commands.board_options import board_from_options
from calib.commands.cover_options import (
    cover_from_options,
    describe_medium,
    describe_usual,
    intrinsics_from_options,
)
from calib.commands.described_session import COMMON as DESCRIPTIONS
from calib.commands.described_session import add_description
from calib.errors import InputError

SUMMARY = "Write a session.yaml to fill in, with a comment beside every key."
DESCRIPTION = """
SESSION is a new folder, or a folder with pictures: session.yaml then has their size. The options
write your own numbers in place of the examples. Put pictures into SESSION/frames, or beside
session.yaml, and pictures without the cover into SESSION/bare.
"""
EXAMPLES = (
    "calib init cam0",
    "calib init cam0 --board 9x6 --square-mm 25 --cover flat --distance 20+-5",
)
COMMON = DESCRIPTIONS | {"--size": "size of the pictures, px"}
SIZE = (1640, 1232)
"""px, the size of the pictures where there are none yet."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, metavar="SESSION", help="the session folder")
    add_description(parser, "written into session.yaml")
    parser.add_argument(
        "--size",
        type=whole_size,
        metavar="WxH",
        help="size of the pictures, px (default: that of most of them, or 1640x1232)",
    )
    add_overwrite(parser)
    parser.usage = "%(prog)s SESSION [options]"


def run(args: argparse.Namespace) -> None:
    from calib.commands.printing import print_paths, print_remark
    from calib.importing.from_pictures import uniform_pictures
    from calib.io.file_set import FileSet
    from calib.io.files import reading
    from calib.io.images import session_pictures
    from calib.session.board_section import EXAMPLES as BOARDS
    from calib.session.board_section import board_to_yaml
    from calib.session.commented import commented_session
    from calib.session.session import session_from_mapping

    folder = args.session
    with reading(folder):
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder} is not a folder: name the folder of the session.")
        pictures = session_pictures(folder)
        if (folder / "session.yaml").exists() and not args.overwrite:
            raise InputError(
                f"{folder / 'session.yaml'} is there already: correct it, or replace it with"
                " --overwrite."
            )
    width, height = args.size or (uniform_pictures(folder, pictures).size if pictures else SIZE)
    board = board_from_options(args)
    described = board_to_yaml(board) if board else {**BOARDS[args.type or "checkerboard"]}
    camera: dict[str, object] = {"width": width, "height": height}
    if intrinsics := intrinsics_from_options(args):
        camera["intrinsics"] = intrinsics
    if args.lens:
        camera["lens"] = args.lens
    cover = cover_from_options(args) or {"shape": "none"}
    session_from_mapping({"board": described, "camera": camera, "cover": cover}, "The command line")
    for assumed in filter(None, (describe_usual(args), describe_medium(args))):
        print_remark(assumed)
    text = commented_session(described, camera, cover)
    with FileSet(folder, overwrite=args.overwrite, inputs=pictures) as files:
        written = files.write("session.yaml", text)
        files.commit()
    print_paths([written])
