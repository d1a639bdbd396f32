"""The command `calib demo`."""

import argparse
import io
import json
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib.resources import files as package_files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import ModuleType

from calib.commands import fit_command, undistort_command
from calib.commands.arguments import add_overwrite
from calib.commands.parser import command_name
from calib.commands.printing import print_json
from calib.commands.program import runnable_command
from calib.commands.report_command import show_report
from calib.errors import InputError
from calib.io.result_names import CALIBRATION_ARRAYS, CALIBRATION_FILE
from calib.io.shell import path_word, shell_line

SUMMARY = "Calibrate pictures that come with calib, and open the report."
DESCRIPTION = """
The pictures are of a checkerboard under water, and of a tiled wall, through the window of a
housing. They were rendered, so the truth is known: the window is 21.0 mm from the lens and tilted
by 2.01 and -1.49 degrees, and session.yaml does not say so. The command copies them, types the
commands that you would type for your own camera, and shows what they print.
"""
EXAMPLES = ("calib demo", "calib demo -o try --no-open")
OWN_FIT = "calib fit PICTURES --board 9x6 --square-mm MM --cover flat"
"""The first command for pictures of a camera of one's own."""
QUIET = "print no progress, no remarks and no tables"
FOLDER = "refracal-demo"
SESSION = "session.yaml"
PICTURE = "wall.jpg"
WALL_DEPTH = "0.8"
"""m, from the lens to the wall in PICTURE."""
RESULTS = (
    CALIBRATION_FILE,
    CALIBRATION_ARRAYS,
    "rays.npz",
    f"map_{WALL_DEPTH}m.npz",
    "report.html",
)
"""The files of the fit: all are checked before the first file is written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(FOLDER),
        metavar="DIR",
        help="folder for the session and its calibration (default: %(default)s)",
    )
    add_overwrite(parser)
    parser.add_argument(
        "--no-open", action="store_true", help="write the report and print its path only"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from calib.io.output_folder import OutputFolder

    if not args.overwrite:
        check_no_calibration(args.output)
    calibration = args.output / "calibration"
    report = calibration / "report.html"
    straight = args.output / "straight"
    for results, names in ((calibration, RESULTS), (straight, (PICTURE,))):
        OutputFolder(results, overwrite=args.overwrite).check(names)
    copy_session(args.output, overwrite=args.overwrite)
    picture = path_word(args.output / PICTURE)
    fit_words = [path_word(args.output), "--depth", WALL_DEPTH]
    undistort_words = [path_word(calibration), picture, "--depth", WALL_DEPTH, "--crop", "0"]
    steps = (
        (fit_command, fit_words),
        (undistort_command, [*undistort_words, "-o", path_word(straight)]),
    )
    if args.json:
        print_json(_quietly(steps, args) | {"undistorted": str(straight / PICTURE)})
    else:
        for command, words in steps:
            print(_command_line(command, words), flush=True)
            _step(command, words, args)
            print()
        print(f"Before: {picture}\nAfter:  {straight / PICTURE}\nReport: {report}")
        print(f"Now your own: {runnable_command(OWN_FIT)}")
    if not (args.no_open or args.json):
        show_report(report)


def check_no_calibration(folder: Path) -> None:
    """Raise InputError if the folder holds a session or a calibration that is not the demo's:
    files that calib wrote for a camera are not foreign, and yet are not to be replaced.
    """
    from calib.io.files import read_file
    from calib.io.output_folder import ANOTHER_FOLDER

    session = folder / SESSION
    demo = package_files("calib") / "demo" / SESSION
    if session.is_file() and read_file(session) == demo.read_bytes():
        return
    for place in (session, folder / RESULTS[0], folder / "calibration" / RESULTS[0]):
        if place.exists():
            raise InputError(
                f"{place} is not the demo's: {ANOTHER_FOLDER}, or replace what is there with"
                " --overwrite."
            )


def copy_session(folder: Path, *, overwrite: bool) -> None:
    """Copy the session and the picture that come with calib; InputError names a file in the way
    that calib did not write.
    """
    from calib.io.file_set import FileSet
    from calib.io.output_folder import OutputFolder

    source = package_files("calib") / "demo"
    copies = [
        (folder / "frames", dict(_files(source / "frames"))),
        (folder, dict(_files(source))),
    ]
    for place, contents in copies:
        OutputFolder(place, overwrite=overwrite).check(contents)
    for place, contents in copies:
        with FileSet(place, overwrite=overwrite) as output:
            for file, data in contents.items():
                output.write(file, data)
            output.commit()


def _files(folder: Traversable) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of each file in a folder of the package."""
    for entry in folder.iterdir():
        if entry.is_file():
            yield entry.name, entry.read_bytes()


def _step(command: ModuleType, words: list[str], args: argparse.Namespace, *extra: str) -> None:
    """Run a command in this process."""
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    overwrite = ["--overwrite"] if args.overwrite else []
    step_args = parser.parse_args([*words, *overwrite, *extra])
    step_args.quiet = args.quiet
    command.run(step_args)


def _quietly(
    steps: tuple[tuple[ModuleType, list[str]], ...], args: argparse.Namespace
) -> dict[str, object]:
    """Run the steps without their output, and return the JSON object of the first, the fit."""
    (fit, fit_words), *others = steps
    with redirect_stdout(io.StringIO()) as output:
        _step(fit, fit_words, args, "--json")
    result: dict[str, object] = json.loads(output.getvalue())
    with redirect_stdout(io.StringIO()):
        for command, words in others:
            _step(command, words, args)
    return result


def _command_line(command: ModuleType, words: list[str]) -> str:
    """Return the line that a person types for a command."""
    return f"$ {runnable_command(shell_line('calib', command_name(command), *words))}"
