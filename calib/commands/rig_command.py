"""The command `calib rig`."""

import argparse
from pathlib import Path

from calib.commands.arguments import add_output, add_overwrite
from calib.commands.fit_options import add_fit_options
from calib.commands.parser import Help

SUMMARY = "Calibrate several cameras behind covers together, and measure with them."
DESCRIPTION = """
RIG is a rig.yaml, or a folder that holds one. It names the cameras, each with a session of its own,
and says which of their pictures belong together: docs/rigs.md.
"""
EXAMPLES = (
    "calib rig fit pair -o pair/calibration",
    "calib rig evaluate pair/calibration pair/holdout",
)
QUIET = "print no progress and no remarks, and of a fit the verdict alone"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    fit = _add_action(actions, "fit", "Calibrate all cameras of a rig, and where they are mounted.")
    _add_rig(fit, "the rig.yaml, or its folder")
    add_output(fit, "folder for the results", required=True)
    add_overwrite(fit)
    add_fit_options(fit)
    evaluate = _add_action(
        actions,
        "evaluate",
        "Measure the error of a calibrated rig on pictures that were not fitted: with one pose of"
        " the board for all cameras, and of lengths on the board.",
    )
    evaluate.add_argument(
        "calibration", type=Path, metavar="CALIBRATION", help="the folder that calib rig fit wrote"
    )
    _add_rig(evaluate, "a rig.yaml with held-out pictures, or its folder")
    for action in (fit, evaluate):
        action.add_argument("--json", action="store_true", help="print one JSON object")
        # The command's own --quiet stands before ACTION.
        action.add_argument(
            "-q", "--quiet", action="store_true", default=argparse.SUPPRESS, help=QUIET
        )


def _add_action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, summary: str
) -> argparse.ArgumentParser:
    return actions.add_parser(name, help=summary, description=summary, formatter_class=Help)


def _add_rig(parser: argparse.ArgumentParser, help_text: str) -> None:
    parser.add_argument("rig", type=Path, metavar="RIG", help=help_text)


def run(args: argparse.Namespace) -> None:
    {"fit": _fit, "evaluate": _evaluate}[args.action](args)


def _fit(args: argparse.Namespace) -> None:
    import time

    from calib.commands.fit_options import settings_of
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.rig_lines import print_rig, rig_json
        from calib.commands.verdict_lines import print_verdict
        from calib.rig.fit_rig import fit_rig
        from calib.rig.judge import judge_rig
        from calib.rig.rig import RigFiles
        from calib.rig.rig_file import read_rig

    start = time.monotonic()
    description = read_rig(args.rig)
    files = RigFiles(
        args.output,
        tuple(description.sessions),
        overwrite=args.overwrite,
        inputs=description.files,
    )
    with files:
        files.reserve()
        with Bars() as bars:
            rig = fit_rig(description, settings_of(args), bars)
        written = files.write(rig)
        files.commit()
    verdict = judge_rig(rig, folder=args.output)
    seconds = time.monotonic() - start
    if args.json:
        print_json(rig_json(rig, seconds) | verdict_mapping(verdict, written))
        return
    if not args.quiet:
        print_rig(rig, seconds)
    print_verdict(verdict, written)


def _evaluate(args: argparse.Namespace) -> None:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.rig_lines import evaluation_json, print_rig_evaluation
        from calib.commands.verdict_lines import print_verdict
        from calib.rig.evaluate_rig import evaluate_rig
        from calib.rig.judge import judge_rig
        from calib.rig.rig import Rig

    rig = Rig.load(args.calibration)
    with Bars() as bars:
        evaluation = evaluate_rig(rig, args.rig, bars)
    folder = args.calibration if args.calibration.is_dir() else args.calibration.parent
    verdict = judge_rig(rig, folder=folder, evaluation=evaluation)
    if args.json:
        print_json(evaluation_json(evaluation) | verdict_mapping(verdict, []))
        return
    print_rig_evaluation(evaluation)
    print_verdict(verdict, [])
