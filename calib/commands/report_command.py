"""The command `calib report`."""

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from calib.commands.arguments import (
    add_calibration,
    add_depths,
    add_output,
    add_overwrite,
    calibration_files,
    folder_of,
)
from calib.commands.loading import fast_imports
from calib.commands.printing import print_remark

SUMMARY = "Write report.html for a calibration and open it in a browser."
DESCRIPTION = """
The report is one file that needs no network. Over SSH, or without a screen, the command prints its
path and opens nothing. With --png, its figures are written to a folder as pictures, for papers, and
the report is left as it is; this needs matplotlib.
"""
EXAMPLES = (
    "calib report cam0/calibration",
    "calib report cam0/calibration -o for-the-customer",
    "calib report cam0/calibration --png figures",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    add_depths(parser, required=False)
    add_output(parser, "folder for the report (default: the calibration's)", required=False)
    add_overwrite(parser)
    parser.add_argument(
        "--png",
        type=Path,
        metavar="DIR",
        help="write the figures as pictures to this folder, and no report",
    )
    parser.add_argument(
        "--no-open", action="store_true", help="write the report and print its path only"
    )


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_paths
        from calib.errors import InputError
        from calib.io.file_set import FileSet
        from calib.report.comparison import undiagnosed
        from calib.report.write import NAME, write_report

    if args.png and args.output:
        raise InputError("--png DIR names the folder of the figures: leave -o out.")
    calibration = Calibration.load(args.calibration)
    if args.png:
        from calib.plots import write_figures

        pictures = FileSet(
            args.png, overwrite=args.overwrite, inputs=calibration_files(args.calibration)
        )
        with pictures as files:
            written = write_figures(calibration, files, args.depth)
            files.commit()
        print_paths(written)
        return
    folder = folder_of(args.calibration)
    if not args.output:
        _check_writable(args.calibration)
    output = FileSet(
        args.output or folder,
        overwrite=args.overwrite,
        inputs=calibration_files(args.calibration),
    )
    with Bars() as bars, output as files:
        files.reserve([NAME])
        before = undiagnosed(calibration)
        path = write_report(
            calibration, files, bars, args.depth, before=before, calibration_folder=folder
        )
        files.commit()
    print_paths([path])
    if not args.no_open:
        show_report(path)


def _check_writable(calibration: Path) -> None:
    """Check that a report can be written beside a calibration; InputError proposes another folder
    for it if not.
    """
    from calib.errors import InputError
    from calib.io.files import check_writable
    from calib.io.shell import shell_path

    folder = folder_of(calibration)
    try:
        check_writable(folder)
    except InputError as error:
        reason = error.__cause__.strerror if isinstance(error.__cause__, OSError) else "no space"
        raise InputError(
            f"{folder} cannot be written ({reason}): write the report into another folder by"
            f" `calib report {shell_path(calibration)} -o report`."
        ) from error


def show_report(path: Path) -> None:
    """Open a report in a browser, if that would open on the screen of the person."""
    import webbrowser

    if has_screen(os.environ, sys.platform):
        webbrowser.open(path.resolve().as_uri())
    else:
        print_remark(f"no screen here: open {path} in a browser.")


def has_screen(environment: Mapping[str, str], platform: str) -> bool:
    """True if a browser would open on the screen of the person."""
    if "SSH_CONNECTION" in environment or "SSH_TTY" in environment:
        return False
    return (
        platform in ("darwin", "win32")
        or "DISPLAY" in environment
        or "WAYLAND_DISPLAY" in environment
    )
