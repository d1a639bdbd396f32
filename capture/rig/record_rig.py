"""The recording of a rig without a screen: `capture record RIG --source NAME=SOURCE ...`."""

import argparse
from concurrent.futures import Future, ThreadPoolExecutor

from calib.commands.board_options import board_from_options
from calib.commands.printing import print_json
from calib.errors import InputError, NotEnoughDataError, RefracalError
from calib.io.shell import shell_path
from calib.session.board import Board
from capture.finders import make_finder
from capture.interrupt import stop_on_signal
from capture.recording_loop import RecordingPlan
from capture.rig.rig_folder import RigFolder
from capture.rig.rig_guide import Advice, RigGuide
from capture.rig.rig_loop import detect_in_rig, record_all, record_moments
from capture.rig.rig_narrator import RigNarrator, RigSilenceRemarks
from capture.rig.rig_reader import RigReader
from capture.rig.rig_recorder import RigRecorder
from capture.rig.rig_setup import read_likes
from capture.rig.rig_sources import open_sources

DEFAULT_VIEWS = 30


def record_rig(args: argparse.Namespace) -> None:
    """Record all cameras of a rig together."""
    sources = open_sources(args.source)
    if args.bare:
        raise InputError(
            "--bare is for one camera at a time: record into the session of each, such as"
            f" capture record {shell_path(args.session / next(iter(sources)))} --source ... --bare."
        )
    rig = RigFolder.of(args.session, tuple(sources))
    likes = read_likes(args.cover_from or (), tuple(sources))
    board = rig.board(board_from_options(args), likes)
    views = args.views or (None if args.all else DEFAULT_VIEWS)
    with (
        RigReader(sources, RigSilenceRemarks()) as reader,
        RigRecorder(
            rig, board, likes=likes, shutters={name: s.shutter for name, s in sources.items()}
        ) as recorder,
        stop_on_signal(reader.close) as stop_request,
    ):
        narrator = RigNarrator(reader, recorder, views, json=args.json)
        try:
            if args.all:
                for step in record_all(reader, recorder, views):
                    narrator.report_step(step)
            else:
                plan = RecordingPlan(views, args.burst, args.every)
                _record(reader, recorder, narrator, board, plan)
        except RefracalError:
            narrator.report_safety()
            raise
    if not narrator.has_pictures and not stop_request.received:
        judged = narrator.sentence or _unpaired_sentence(reader)
        raise NotEnoughDataError(f"No picture of {', '.join(sources)} was kept: {judged}")
    ended = (
        "interrupted" if stop_request.received else "views" if narrator.views == views else "source"
    )
    if args.json:
        print_json(narrator.as_json(ended=ended))
    else:
        narrator.print_summary()


def _record(
    reader: RigReader,
    recorder: RigRecorder,
    narrator: RigNarrator,
    board: Board,
    plan: RecordingPlan,
) -> None:
    finders = {name: make_finder(board) for name in reader.sources}
    views = detect_in_rig(recorder, finders)
    guide: RigGuide | None = None
    advice: Future[Advice] | None = None
    with ThreadPoolExecutor(1) as adviser:
        for step in record_moments(reader, finders, board, recorder, plan, views):
            narrator.report_step(step)
            if step.pictures and reader.live:
                sizes = {name: frame.size for name, frame in step.moment.frames.items()}
                guide = guide or RigGuide(board, recorder.cameras(sizes))
                if advice:
                    advice.cancel()  # it is about fewer views
                advice = adviser.submit(guide.advise, tuple(views))
            if advice and advice.done():
                narrator.report_advice(*advice.result())
                advice = None
        if advice:
            advice.cancel()


def _unpaired_sentence(reader: RigReader) -> str:
    tolerance = reader.pairing.tolerance_s
    if tolerance is None:
        return "no two pictures have the same name, or a source has fewer than two pictures."
    return (
        f"none were taken within {1000 * tolerance:.1f} ms of each other. Give the cameras the same"
        " frame rate, and recordings times of one clock."
    )
