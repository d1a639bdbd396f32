"""The work of `calib stream`. Sources and screens belong to this package, so the command of `calib`
names this module and does not import it (docs/decisions/streams.md).
"""

import argparse
import sys
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from calib.commands.loading import fast_imports

if TYPE_CHECKING:
    from capture.streaming.places import TargetPlace
    from capture.streaming.straightener import Straightener
    from capture.streaming.stream import Stream
    from capture.streaming.target import StreamTarget
    from capture.tui.stream_window import StreamApp


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.apply.angular_reach import undistortion_limit
        from calib.apply.asked_depths import describe_all
        from calib.calibration import Calibration
        from calib.commands.printing import print_json
        from calib.errors import RefracalError
        from calib.io.json_text import json_text
        from capture.sources.registry import open_source
        from capture.sources.video import VideoSource
        from capture.streaming.depth_file import DepthFile
        from capture.streaming.narrator import StreamNarrator
        from capture.streaming.places import parse_places
        from capture.streaming.straightener import Straightener
        from capture.streaming.stream import Stream
        from capture.streaming.view import StreamView

    places = parse_places(args.to)
    calibration = Calibration.load(args.calibration)
    size = f"{calibration.camera.width}x{calibration.camera.height}"
    camera_options = {"size": size, "colour": "yes", "auto": "yes"}
    source = partial(open_source, args.source, camera_options=camera_options)
    unopened = source()  # a text that names no source is refused before anything is opened
    window = _window() if any(place.kind == "window" for place in places) else None
    narrator = StreamNarrator()
    listener = window or narrator
    straightener = Straightener(
        calibration,
        StreamView(args.depth, args.crop, args.scale),
        fixed_size=any(place.fixed_size for place in places),
        depth_file=args.depth_image and DepthFile(args.depth_image, args.near, listener.tell),
        tell=listener.tell,
    )
    if limit := undistortion_limit(calibration):
        narrator.tell(limit)
    if blackness := straightener.describe_black():
        narrator.tell(blackness)
    for remark in describe_all(calibration, [args.depth] if args.depth is not None else []):
        narrator.tell(remark)
    targets: list[StreamTarget] = [window] if window else []
    is_watched = any(place.kind in ("window", "http") for place in places)
    paced = is_watched and isinstance(unopened, VideoSource)  # a folder has its own speed
    stream = Stream(source, straightener, targets, listener, paced=paced)
    targets += [
        _target(place, args, stream, straightener) for place in places if place.kind != "window"
    ]
    counts = stream.statistics
    try:
        ended = _show(window, stream, straightener) if window else _stream(stream)
    except RefracalError:
        if counts.frames:
            narrator.finish(counts)
        raise
    narrator.finish(counts)
    if args.json:
        result = {**counts.as_json(), "view": asdict(straightener.view), "ended": ended}
        if any(place.kind == "pipe" for place in places):
            print(json_text(result), file=sys.__stderr__)  # also if remarks are silenced
        else:
            print_json(result)


def _stream(stream: "Stream") -> str:
    from capture.interrupt import stop_on_signal

    with stop_on_signal(stream.close):
        return stream.run()


def _window() -> "StreamApp":
    from calib.errors import InputError

    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError(
            "This is not a terminal, which --to window needs: run the command in one, or choose"
            " another --to."
        )
    from capture.tui.stream_window import StreamApp

    return StreamApp()


def _show(window: "StreamApp", stream: "Stream", straightener: "Straightener") -> str:
    window.attach(stream, straightener)
    ended = window.run()
    if window.error:
        raise window.error
    return ended or "interrupted"


def _target(
    place: "TargetPlace", args: argparse.Namespace, stream: "Stream", straightener: "Straightener"
) -> "StreamTarget":
    """Return the target of a place. It opens nothing before `with`."""
    if place.kind == "v4l2":
        from capture.streaming.loopback import LoopbackTarget

        return LoopbackTarget(place.device, straightener.size)
    if place.kind == "pipe":
        from capture.streaming.pipe import PipeTarget

        return PipeTarget(
            straightener.size,
            stream.stop,
            stream.listener.tell,
            raw=args.pixels == "raw",
            rate=args.rate,
        )
    from capture.streaming.web_target import WebTarget

    def state() -> dict[str, object]:
        return {
            "view": asdict(straightener.view),
            "depth_image": args.depth_image and str(args.depth_image),
            "size": straightener.size,
            "problem": straightener.problem,
            "counts": stream.statistics.line(),
            **stream.statistics.as_json(),
        }

    return WebTarget(args.host, place.port, straightener.change, state, stream.listener.tell)
