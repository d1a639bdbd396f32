"""The command `calib diagnose`."""

import argparse
import textwrap
from pathlib import Path

from calib.commands.arguments import add_output, add_overwrite, calibration_files, folder_of
from calib.commands.effect_names import effects_help, registered_names
from calib.commands.loading import fast_imports
from calib.commands.parser import HELP_ALL
from calib.io.result_names import DIAGNOSED

SUMMARY = (
    "Find why the error is larger than the noise, such as a bent board, and correct it if pictures"
    " that were not fitted confirm it."
)
DESCRIPTION = """
The new folder gets the calibration with the accepted effects, and its report.html. The report shows
the error with and without the effects on views that were not fitted. Without --holdout, the
calibration's own views are held out in turn.
"""
EXAMPLES = (
    "calib diagnose cam0/calibration",
    "calib diagnose cam0/calibration --holdout holdout -o better",
)
COMMON = {
    "CALIBRATION": "calibration.yaml, or its folder",
    "--holdout": "views that were not fitted, to measure with",
    "-o": "folder for the result: CALIBRATION/diagnosed",
    "--json": "print one JSON object",
    "--quiet": "print the files and the verdict alone",
    "--overwrite": "replace files that calib did not write",
}
QUIET = "print the files and the verdict: no progress, no remarks and no tables"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "calibration", type=Path, metavar="CALIBRATION", help="calibration.yaml, or its folder"
    )
    parser.add_argument(
        "--holdout",
        type=Path,
        metavar="SESSION",
        help="a session of views that were not fitted, to measure with",
    )
    add_output(
        parser,
        "folder for the result (default: diagnosed/ in the folder of calibration.yaml)",
        required=False,
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.usage = "%(prog)s CALIBRATION [options]"
    parser.epilog = effects_help()


def common_epilog() -> str:
    """Return the names of the effects in a few lines."""
    names = ", ".join(registered_names())
    lines = textwrap.wrap(names, 76, break_on_hyphens=False, break_long_words=False)
    return "\n  ".join([f"effects that it looks for, which {HELP_ALL} describes:", *lines])


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.calibration import Calibration
        from calib.calibration_file import DERIVED, FILES
        from calib.commands.console import Bars
        from calib.commands.diagnosis_table import print_diagnosis
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.verdict_lines import print_verdict
        from calib.diagnosis.diagnose import diagnose
        from calib.fitting.description import calibrated_numbers
        from calib.fitting.evaluate import held_out_session
        from calib.fitting.provenance import record_diagnosis
        from calib.io.file_set import FileSet
        from calib.io.output_folder import check_no_link
        from calib.report.write import NAME, write_report
        from calib.verdict.judge import judge

    calibration = Calibration.load(args.calibration)
    holdout = held_out_session(args.holdout, calibration)[0] if args.holdout else None
    output = args.output or check_no_link(folder_of(args.calibration) / DIAGNOSED)
    inputs = [*calibration_files(args.calibration), *(holdout.files if holdout else ())]
    with FileSet(output, overwrite=args.overwrite, inputs=inputs) as files:
        files.reserve([*FILES, NAME])
        with Bars() as bars:
            better, finding = diagnose(calibration, bars, holdout)
            better = record_diagnosis(better, folder_of(args.calibration), args.holdout)
            written = [better.write(files)]
        try:
            with Bars() as bars:
                written.append(write_report(better, files, bars, before=calibration))
        finally:  # if the report fails, the finding is still written and printed
            files.commit(instead_of=DERIVED)
            # where nothing was found, the calibration as it was given is the one to use
            used = output if finding.added else folder_of(args.calibration)
            verdict = judge(
                better, folder=used, evaluation=finding.evaluation, holdout=args.holdout
            )
            if args.json:
                print_json(
                    finding.as_json()
                    | calibrated_numbers(better)
                    | {"calibration": str(written[0])}
                    | verdict_mapping(verdict, written)
                )
            else:
                if not args.quiet:
                    print_diagnosis(finding, better)
                print_verdict(verdict, written)
