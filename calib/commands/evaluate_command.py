"""The command `calib evaluate`."""

import argparse
from pathlib import Path

from calib.commands.arguments import add_calibration, calibration_files, check_order, folder_of
from calib.commands.loading import fast_imports

SUMMARY = "Measure the error of a calibration on views that were not fitted."
DESCRIPTION = """
Camera and cover come from CALIBRATION, board and views from SESSION: a session, or a folder of
pictures of the calibration's board. Only the pose of each view is fitted again.
"""
EXAMPLES = (
    "calib evaluate cam0/calibration holdout",
    "calib evaluate cam0/calibration holdout --json",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    views = "a folder with held-out views: a session, or pictures"
    parser.add_argument("session", type=Path, metavar="SESSION", help=views)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from dataclasses import asdict

    with fast_imports():
        from calib.calibration import Calibration
        from calib.commands.console import Bars, print_evaluation
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.verdict_lines import print_verdict
        from calib.fitting.description import calibrated_numbers
        from calib.fitting.evaluate import evaluate
        from calib.verdict.judge import judge

    check_order(args.calibration, [args.session])
    calibration = Calibration.load(args.calibration)
    with Bars() as bars:
        evaluation = evaluate(calibration, args.session, bars)
    verdict = judge(
        calibration, folder=folder_of(args.calibration), evaluation=evaluation, holdout=args.session
    )
    if args.json:
        print_json(
            {k: v for k, v in asdict(evaluation).items() if k not in ("rejected", "board")}
            | calibrated_numbers(calibration)
            | {"calibration": str(calibration_files(args.calibration)[0])}
            | verdict_mapping(verdict, [])
        )
    else:
        is_wide = calibration.model()[0].lens.wide
        fitted_px = calibration.stages[-1].rms_px if calibration.stages else None
        print_evaluation(evaluation, fitted_px, wide=is_wide)
        print_verdict(verdict, [])
