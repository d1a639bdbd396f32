"""The options of `capture ui` for a screen as the target, and the recording."""

import argparse
import sys
from pathlib import Path

from calib.commands.arguments import positive_number, quoted
from calib.io.numerals import whole_number
from calib.io.shell import shell_path

POSES = 8
"""Poses of a session; from six on, its maps are as exact as those of 24 boards or more."""


def add_screen(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    group = parser.add_argument_group("a screen as the target", "with --serve")
    group.add_argument(
        "--screen",
        action="store_true",
        help="the page shows patterns, which the camera photographs, in place of a board",
    )
    group.add_argument(
        "--poses",
        type=_poses,
        metavar="N",
        help=f"number of poses of the screen to record (default: {POSES})",
    )
    group.add_argument(
        "--pitch-mm",
        type=positive_number,
        metavar="MM",
        help="from pixel to pixel, from the data sheet (default: the page helps to measure it)",
    )
    group.add_argument(
        "--period",
        type=positive_number,
        metavar="PX",
        help="screen pixels in a fringe (default: the best for each pose)",
    )


def check_screen_options(args: argparse.Namespace) -> None:
    """Raise InputError for options that do not belong together."""
    from calib.errors import InputError

    if args.screen and not args.serve:
        raise InputError(
            "--screen needs a browser that shows the patterns: add --serve, and --host 0.0.0.0 for"
            " the browser of another machine."
        )
    alone = ("poses", "pitch_mm", "period")
    for name in () if args.screen else alone:
        if getattr(args, name) is not None:
            raise InputError(
                f"--{name.replace('_', '-')} belongs to --screen: add that, or leave it out."
            )


def record_screen(args: argparse.Namespace) -> None:
    """Record a screen's poses until there are enough, or a signal ends it."""
    from calib.errors import InputError, harmless
    from capture.interrupt import stop_on_signal
    from capture.narrator import SilenceRemarks
    from capture.reader import Reader
    from capture.rig.rig_sources import is_rig
    from capture.screen.eye import Eye, Stopped
    from capture.screen.page import PatternPage
    from capture.screen.pitch import known_pitch
    from capture.screen.points_session import PointsSession, read_template
    from capture.screen.recording import ScreenRecording
    from capture.sources.registry import is_recorded_source, open_source, usable_cameras

    def tell(sentence: str) -> None:
        print(harmless(sentence), file=sys.stderr, flush=True)

    def report_pose(path: Path, sentence: str) -> None:
        print(harmless(f"{path}  pose {len(session.pixels)} of {poses}: {sentence}"), flush=True)

    poses = args.poses or POSES
    pitch = known_pitch(args.pitch_mm) if args.pitch_mm else None
    like = read_template(Path(args.cover_from[-1])) if args.cover_from else None
    sources = args.source or usable_cameras()
    if is_rig(sources):
        raise InputError("--screen is for one camera: give one --source without a name.")
    source_text = next(iter(sources), "")
    if not source_text:
        raise InputError(
            "This machine has no camera that can be used: capture sources says what is missing."
        )
    source = open_source(source_text)
    if is_recorded_source(source_text):
        raise InputError(
            f"--source {source_text} is a recording, which cannot see what a screen shows now: name"
            " a camera (capture sources lists them)."
        )
    with (
        PointsSession(args.session, like) as session,
        Reader(source, SilenceRemarks()) as reader,
        stop_on_signal(reader.close) as stop_request,
        PatternPage(args.host, args.port) as page,
    ):
        for remark in source.remarks:
            tell(remark)
        _print_address(page.address, page.has_token)
        eye = Eye(reader, page, lambda: stop_request.received)
        recording = ScreenRecording(
            eye,
            session,
            poses,
            period=args.period,
            pitch=pitch,
            tell=tell,
            report_pose=report_pose,
        )
        try:
            recording.run()
        except Stopped:
            tell("Ended. The same command goes on.")
        print(harmless(f"{len(session.pixels)} of {poses} poses in {args.session}."))
        if len(session.pixels) >= poses:
            tell(f"Next: calib fit {shell_path(args.session)}")


def _print_address(address: str, has_token: bool) -> None:
    from capture.qr_code import qr_code

    print(address, flush=True)
    if has_token and sys.stderr.isatty() and "utf" in sys.stderr.encoding.lower():
        print(qr_code(address), file=sys.stderr)
    where = "the machine whose screen is the target" if has_token else "this machine"
    print(
        f"Open this address in a browser of {where}. Ctrl-C ends it.", file=sys.stderr, flush=True
    )


def _poses(text: str) -> int:
    count = whole_number(text)
    if count is None or not 1 <= count <= 999:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of poses: write a whole number from 1 to 999, such as"
            f" {POSES}"
        )
    return count
