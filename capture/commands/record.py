"""The command `capture record`."""

import argparse
from pathlib import Path

from calib.commands.arguments import positive_number, quoted
from calib.commands.board_options import add_coding, board_from_options
from calib.io.numerals import whole_number
from calib.io.shell import shell_path
from capture.commands.corner_counts import corner_counts

SUMMARY = "Record a session without a screen: keep sharp frames that show the board in a new pose."
DESCRIPTION = """
SOURCE is v4l2:/dev/video0, libcamera:0, rpicam:0, folder:PATH or video:FILE; options follow a
question mark, such as v4l2:/dev/video0?size=1640x1232. A session that has pictures is continued.
Ctrl-C ends the recording and loses nothing. Several cameras, each as --source NAME=SOURCE, are
recorded together: SESSION is then the folder of the rig, with rig.yaml and a session a camera.
"""
EXAMPLES = (
    "capture record cam0 --source v4l2:/dev/video0 --board 9x6 --square-mm 25",
    "capture record cam0 --source film.mp4 --board 9x6 --square-mm 25",
)
COMMON = {
    "SESSION": "the session folder, which is made if need be",
    "--source": "the camera; capture sources lists them",
    "--board": "the board's inner corners, such as 9x6",
    "--square-mm": "side of a square",
    "--type": "checkerboard, charuco, aprilgrid, gridboard",
    "--cover-from": "a session.yaml with the same cover and camera",
    "--bare": "the cover is off: record into bare/",
    "--views": "views to keep, then end (default: 30)",
    "--all": "keep every frame, whatever is in it",
    "--json": "print one JSON object at the end",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session", type=Path, metavar="SESSION", help="the session folder, which is made if need be"
    )
    parser.add_argument(
        "--source",
        required=True,
        action="append",
        help="where frames come from; `capture sources` lists the cameras. Of a rig, NAME=SOURCE"
        " for each camera",
    )
    parser.add_argument(
        "--board",
        type=corner_counts,
        metavar="COLSxROWS",
        help="inner corners of a new session's board, or its tags, such as 9x6",
    )
    parser.add_argument("--square-mm", type=positive_number, metavar="MM", help="side of a square")
    add_coding(parser)
    parser.add_argument(
        "--cover-from",
        action="append",
        metavar="FILE",
        help="session.yaml that describes cover and camera of a new session; of a rig, FILE for"
        " all cameras, or NAME=FILE for each",
    )
    parser.add_argument("--bare", action="store_true", help="the cover is off: record into bare/")
    parser.add_argument(
        "--views",
        type=_count,
        metavar="N",
        help="views to keep, then end (default: 30; with --all, no end)",
    )
    parser.add_argument(
        "--burst",
        type=_count,
        default=1,
        metavar="N",
        help="pictures of each view, of the still board (default: 1)",
    )
    parser.add_argument(
        "--every",
        type=positive_number,
        default=0.0,
        metavar="S",
        help="the least time between two views, in seconds",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="keep every frame, whatever is in it; of a rig, every moment",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.usage = "%(prog)s SESSION --source SOURCE [options]"


def run(args: argparse.Namespace) -> None:
    from calib.errors import InputError
    from capture.result_folder import refuse_result_folder
    from capture.rig.rig_sources import is_rig, refuse_rig_folder

    if args.all and (args.burst > 1 or args.every):
        raise InputError(
            "--burst and --every choose among good views: leave them out, or leave --all out."
        )
    refuse_result_folder(args.session)
    if is_rig(args.source):
        from capture.rig.record_rig import record_rig

        record_rig(args)
        return
    refuse_rig_folder(args.session)
    _record_session(args)


def _record_session(args: argparse.Namespace) -> None:
    from itertools import islice

    from calib.commands.printing import print_json
    from calib.errors import InputError, NotEnoughDataError, RefracalError, harmless
    from calib.session.shapes.none import NONE
    from capture.finders import make_finder
    from capture.interrupt import stop_on_signal
    from capture.narrator import Narrator, SilenceRemarks
    from capture.other_board_search import OtherBoardSearch
    from capture.reader import Reader
    from capture.recorder import Recorder
    from capture.recording_loop import RecordingPlan, detect_in_pictures, record_views
    from capture.session_file import board_of, read_setup
    from capture.source_folder import check_source_folder, describe_mismatch, describe_repeat
    from capture.sources.registry import open_source

    (source_text,) = args.source
    source = open_source(source_text)
    like = read_setup(Path(args.cover_from[-1])) if args.cover_from else None
    board = board_of(args.session, board_from_options(args), like)
    views = args.views or (None if args.all else 30)
    if args.bare:
        check_source_folder(source_text, covered=False)
    if repeat := describe_repeat(source_text, args.session, covered=not args.bare):
        raise InputError(repeat)
    with (
        Reader(source, SilenceRemarks()) as reader,
        Recorder(
            args.session, board, like=like, bare=args.bare, shutter=reader.source.shutter
        ) as recorder,
        stop_on_signal(reader.close) as stop_request,
    ):
        if args.bare and (mismatch := describe_mismatch(source_text, covered=False)):
            recorder.remarks.append(mismatch)
        search = OtherBoardSearch(board)
        narrator = Narrator(reader, recorder, views, json=args.json)
        try:
            if args.all:
                for view, frame in enumerate(islice(reader, views), start=1):
                    narrator.report_picture(recorder.keep(frame), view)
            else:
                finder = make_finder(board)
                plan = RecordingPlan(views or 0, args.burst, args.every, played=not source.live)
                for step in record_views(
                    reader, finder, recorder, plan, detect_in_pictures(recorder.pictures, finder)
                ):
                    narrator.report_step(step)
                    search.add(step)
        except RefracalError:
            narrator.report_safety()
            raise
    if not narrator.pictures and not stop_request.received:
        other_board = search.describe().replace("calib fit", "capture record")
        reason = other_board or narrator.sentence
        raise NotEnoughDataError(f"No frame of {source_text} was kept: {reason}")
    ended = (
        "interrupted" if stop_request.received else "views" if narrator.views == views else "source"
    )
    if args.json:
        print_json(narrator.as_json(ended=ended))
    else:
        narrator.print_summary()
        if narrator.pictures:
            _, _, cover = read_setup(args.session / "session.yaml")
            has_cover = cover.shape != NONE.name
            print(harmless(f"Next: {_next_step(args.session, bare=args.bare, covered=has_cover)}"))


def _next_step(session: Path, *, bare: bool, covered: bool) -> str:
    """Return what to do after a recording, `covered` if session.yaml describes a cover."""
    from calib.io.output_folder import OutputFolder

    place = shell_path(session)
    if bare:
        return f"put the cover on, then `capture record {place} --source SOURCE`"
    if covered:
        return f"calib fit {place}"
    if not OutputFolder(session).owns("session.yaml"):
        return (
            "if the camera is behind glass, write cover: {shape: unknown}, or what you know of it,"
            f" in {session / 'session.yaml'}. Then `calib fit {place}`"
        )
    return (
        f"`calib fit {place}`. If the camera is behind glass, `calib fit {place} --cover unknown`,"
        " or with what you know of it, such as --cover dome --radius 40+-5"
    )


def _count(text: str) -> int:
    count = whole_number(text)
    if not count:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of them: write a whole number above 0"
        )
    return count
