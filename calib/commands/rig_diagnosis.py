"""The action `calib rig diagnose`."""

from __future__ import annotations

import argparse
from pathlib import Path

from calib.commands.arguments import add_output, add_overwrite, folder_of
from calib.commands.loading import fast_imports

SUMMARY = (
    "Find out why the cameras of a calibrated rig disagree: one exposes later, or a mounting flexes"
    " or slipped; and whether the board bends differently in every placement, or moves while a"
    " picture is read out. The causes that held-out placements confirm are added to the rig."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "calibration", type=Path, metavar="CALIBRATION", help="the folder that calib rig fit wrote"
    )
    add_output(
        parser,
        "folder for the diagnosed rig (default: diagnosed/ beside CALIBRATION)",
        required=False,
    )
    add_overwrite(parser)


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.rig_diagnosis_lines import print_rig_diagnosis
        from calib.commands.verdict_lines import print_verdict
        from calib.io.output_folder import check_no_link
        from calib.report.write import NAME
        from calib.rig.diagnose_rig import diagnose_rig
        from calib.rig.judge import judge_rig
        from calib.rig.report import write_rig_report
        from calib.rig.rig import Rig
        from calib.rig.rig_storage import RigFiles

    rig = Rig.load(args.calibration)
    output = args.output or check_no_link(folder_of(args.calibration) / "diagnosed")
    with RigFiles(output, rig.names, overwrite=args.overwrite) as files:
        files.reserve([NAME])
        with Bars() as bars:
            better, diagnosis = diagnose_rig(rig, bars)
        written = files.write(better)
        verdict = judge_rig(better, folder=output)
        try:
            written.append(write_rig_report(better, verdict, files.rig))
        finally:  # if the report fails, the rig is still written
            files.commit()
    if args.json:
        print_json(diagnosis.as_json() | verdict_mapping(verdict, written))
        return
    if not args.quiet:
        print_rig_diagnosis(diagnosis)
    print_verdict(verdict, written)
