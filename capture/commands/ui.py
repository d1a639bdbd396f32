"""The command `capture ui`."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import positive_number, quoted
from calib.commands.board_options import add_coding
from calib.io.numerals import whole_number
from calib.io.shell import shell_path
from capture.commands.corner_counts import corner_counts
from capture.commands.screen_options import add_screen, check_screen_options, record_screen

if TYPE_CHECKING:
    from capture.tui.app import CaptureApp

SUMMARY = (
    "Start the guiding screen, from the first picture to maps. `capture SESSION` is short for it."
)
DESCRIPTION = """
SOURCE is v4l2:/dev/video0, libcamera:0, rpicam:0, folder:PATH or video:FILE; options follow a
question mark. With --serve the screen is shown in a browser of this machine instead of the
terminal. With --host it is shown in browsers of other machines, too: they need the address that the
command prints. With --screen the browser's own screen is the target, in place of a board.

Several cameras, each as --source NAME=SOURCE, are recorded together: SESSION is then the folder of
the rig. --board, --square-mm and --type describe the board of a new rig.
"""
COMMON = {
    "SESSION": "the session folder, which is made if need be",
    "--source": "the camera; capture sources lists them",
    "--serve": "in a browser instead of this terminal",
    "--host": "with --serve: 0.0.0.0 is for other machines",
    "--port": "with --serve: the port (default: 8000)",
    "--board": "of a new rig: inner corners, such as 9x6",
    "--square-mm": "of a new rig: side of a square",
    "--cover-from": "a session.yaml with the same cover and camera",
    "--screen": "a screen is the target, in place of a board",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session", type=Path, metavar="SESSION", help="the session folder, which is made if need be"
    )
    parser.add_argument(
        "--source",
        action="append",
        default=[],
        help="where frames come from (default: the first camera that is found). Of a rig,"
        " NAME=SOURCE for each camera",
    )
    missing = "" if find_spec("textual_serve") else "; first install what it names"
    parser.add_argument(
        "--serve", action="store_true", help=f"in a browser instead of this terminal{missing}"
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="with --serve: the address to serve on (default: %(default)s)",
    )
    parser.add_argument(
        "--port",
        type=_port,
        default=8000,
        metavar="N",
        help="with --serve: the port (default: %(default)s)",
    )
    apps = "with --serve: windows at a time; one more ends the oldest (default: %(default)s)"
    parser.add_argument("--apps", type=_apps, default=1, metavar="N", help=apps)
    board = parser.add_argument_group("the board of a new rig")
    board.add_argument(
        "--board",
        type=corner_counts,
        metavar="COLSxROWS",
        help="its inner corners, or its tags, such as 9x6",
    )
    board.add_argument("--square-mm", type=positive_number, metavar="MM", help="side of a square")
    add_coding(board)
    parser.add_argument(
        "--cover-from",
        action="append",
        metavar="FILE",
        help="session.yaml that describes cover and camera of a new session with --screen;"
        " of a rig, FILE for all cameras, or NAME=FILE for each",
    )
    add_screen(parser)
    parser.usage = "%(prog)s SESSION [options]"


def run(args: argparse.Namespace) -> None:
    from capture.result_folder import refuse_result_folder
    from capture.rig.rig_sources import is_rig, refuse_rig_folder

    check_screen_options(args)
    refuse_result_folder(args.session)
    if args.screen:
        record_screen(args)
        return
    if is_rig(args.source):
        _run_rig(args)
        return
    _refuse_rig_options(args)
    refuse_rig_folder(args.session)
    (source,) = args.source or ("",)
    if source:
        from capture.sources.registry import open_source

        open_source(source)
    if _has_session_file(args.session):
        from capture.session_file import board_of

        board_of(args.session, None)
    if not _serve(args):
        from capture.tui.app import CaptureApp

        _run_app(CaptureApp(args.session, source))


def _serve(args: argparse.Namespace) -> bool:
    """Serve the screen if that is asked for. In the process that is served, return False."""
    from capture.orphan import end_with_server, is_served

    if args.serve and not is_served():
        from capture.serve import serve

        serve(args.words, args.host, args.port, args.apps)
        return True
    _check_terminal(args.session)
    end_with_server()
    return False


def _run_app(app: CaptureApp) -> None:
    app.run()
    if not app.is_web:
        print(*app.farewell, sep="\n")


def _refuse_rig_options(args: argparse.Namespace) -> None:
    from calib.errors import InputError

    for option in ("board", "square_mm", "cover_from"):
        if getattr(args, option):
            raise InputError(
                f"--{option.replace('_', '-')} is not for one camera and a board, which the screen"
                " asks about: leave it out, or name each camera of a rig by --source NAME=SOURCE."
            )


def _run_rig(args: argparse.Namespace) -> None:
    from calib.commands.board_options import board_from_options
    from capture.rig.rig_folder import RigFolder
    from capture.rig.rig_setup import RigSetup, read_likes
    from capture.rig.rig_sources import open_sources

    cameras = tuple(open_sources(args.source))
    rig = RigFolder.of(args.session, cameras)
    likes = read_likes(args.cover_from or (), cameras)
    board = rig.board(board_from_options(args), likes)
    if not _serve(args):
        from capture.tui.rig_app import RigApp

        _run_app(RigApp(RigSetup(rig, tuple(args.source), board, likes)))


def _port(text: str) -> int:
    port = whole_number(text)
    if port is None or not 1 <= port <= 65535:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a port: write a whole number from 1 to 65535, such as 8000"
        )
    return port


def _apps(text: str) -> int:
    count = whole_number(text)
    if count is None or not 1 <= count <= 99:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of windows: write a whole number from 1 to 99, such"
            " as 1"
        )
    return count


def _has_session_file(session: Path) -> bool:
    """Return True if the session has a session.yaml. InputError where the path is not a folder or
    may not be read, which the screen would otherwise hit at every turn.
    """
    from calib.errors import InputError
    from calib.io.files import reading
    from calib.io.images import list_images

    with reading(session):
        if session.exists() and not session.is_dir():
            raise InputError(
                f"{session} is not a folder: name the session's folder, which is made if need be."
            )
        for folder in (session, session / "frames", session / "bare"):
            if folder.is_dir():
                list_images(folder)
        return (session / "session.yaml").exists()


def _check_terminal(session: Path) -> None:
    """Refuse to wait for keys that nobody can press.

    Another driver, such as the browser's, needs no terminal.
    """
    import os
    import sys

    from calib.errors import InputError

    if os.environ.get("TEXTUAL_DRIVER"):
        return
    folder = shell_path(session)
    instead = f"record without a screen: `capture record {folder} --source SOURCE`."
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError(f"This is not a terminal: run `capture {folder}` in one, or {instead}")
    if os.environ.get("TERM") == "dumb":
        raise InputError(
            f"This terminal shows no screens (TERM is dumb): use `capture {folder} --serve` and a"
            f" browser, or {instead}"
        )
