"""The command `calib batch`."""

import argparse
import math
import re
from pathlib import Path

from calib.commands.arguments import add_depths, add_output, add_overwrite, quoted
from calib.commands.fit_options import add_fit_options, settings_of
from calib.errors import InputError, NotEnoughDataError
from calib.export.formats import FORMATS
from calib.fleet.cluster import QUEUES
from calib.io.numerals import whole_number

SUMMARY = "Calibrate a fleet of cameras, and find those that stand out."
DESCRIPTION = """
For each camera, calib batch fits the session, checks it against the camera's prior, diagnoses it
if the verdict asks for that, and exports it.

MANIFEST is a CSV or YAML file that lists cameras (id and session; optionally serial, prior,
fixture, date and limits), or a list of sessions such as 'sessions/*'. DIR gets fleet.html, which
shows which cameras stand out and why, fleet.csv, and a folder and a JSON file for each camera in
cameras/.

The work runs on this machine, at a Dask --scheduler, or as jobs of --jobqueue. Run the same command
again to continue: it repeats only cameras that are not finished or whose session has changed. Exit
code 6: the cluster was lost, or no worker could start, before every camera was done.
"""
EXAMPLES = (
    "calib batch 'sessions/*' -o fleet",
    "calib batch cameras.csv --depth 1 --format opencv -o fleet",
)
COMMON = {
    "MANIFEST": "a CSV or YAML of cameras, or sessions",
    "-o": "folder for the fleet's results",
    "--depth": "distances of the scene that maps are for",
    "--format": "export the cameras: calib export --help",
    "--workers": "how many cameras at a time",
    "--memory": "memory of each worker, such as 4GB",
    "--scheduler": "a Dask cluster, such as tls://head:8786",
    "--jobqueue": "slurm, pbs, sge, lsf, oar, moab, htcondor",
    "--json": "print one JSON object",
}

FOLDS = 4
"""The default of --folds: cameras are compared by their held-out errors."""
MEMORY = re.compile(r"([0-9]+(?:\.[0-9]+)?) *([KMGT])i?B?", re.IGNORECASE)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "manifest",
        nargs="+",
        metavar="MANIFEST",
        help="a CSV or YAML of cameras, a glob of sessions, or sessions",
    )
    add_output(
        parser, "where the fleet's results go: a folder that every worker sees", required=True
    )
    add_overwrite(parser)
    add_fit_options(parser, default_folds=FOLDS)
    add_depths(parser, required=False)
    parser.add_argument(
        "--format",
        dest="formats",
        choices=[form.name for form in FORMATS],
        nargs="+",
        action="extend",
        default=[],
        metavar="FORMAT",
        help=(
            "export every camera that may be used, at every --depth; calib export --help lists the"
            " formats"
        ),
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="a Dask cluster that exists, such as tls://head:8786",
    )
    where.add_argument(
        "--jobqueue",
        default="",
        choices=[*QUEUES],
        help="run workers as jobs of this queue, as dask-jobqueue's file describes it",
    )
    parser.add_argument(
        "--workers",
        type=_workers,
        metavar="N",
        help="number of workers (default: one for each core, or fewer if the memory is too small)",
    )
    parser.add_argument(
        "--memory",
        type=_memory,
        metavar="SIZE",
        help="memory that each worker may take, such as 4GB",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.usage = "%(prog)s MANIFEST ... -o DIR [options]"


def run(args: argparse.Namespace) -> None:
    import sys

    from calib.commands.batch_lines import fleet_json, print_fleet
    from calib.commands.console import Bars
    from calib.commands.printing import print_json
    from calib.fleet.batch import calibrate_fleet
    from calib.fleet.cluster import Place
    from calib.fleet.identity import FleetOptions
    from calib.fleet.manifest import read_manifest

    depths, formats = tuple(dict.fromkeys(args.depth)), tuple(dict.fromkeys(args.formats))
    for form in FORMATS:
        if form.name in formats and form.needs_depth and not depths:
            raise InputError(
                f"--format {form.name} holds for one depth: write the distance of the scene in"
                " metres, such as --depth 1.0."
            )
        if form.name in formats and not form.writable:
            raise InputError(form.lacking)
    entries = read_manifest(args.manifest)
    options = FleetOptions(settings_of(args), depths, formats)
    place = Place(args.scheduler, args.jobqueue, args.workers, args.memory)
    with Bars() as bars:
        fleet, written = calibrate_fleet(
            entries,
            options,
            args.output.absolute(),
            place,
            bars,
            lambda line: print(line, file=sys.stderr),
            [path for path in map(Path, args.manifest) if path.is_file()],
            overwrite=args.overwrite,
        )
    if args.json:
        print_json(fleet_json(fleet, written))
    else:
        print_fleet(fleet, written)
    if not any(result.verdict for result in fleet.results):
        raise NotEnoughDataError(
            f"No camera is calibrated. For example, {fleet.results[0].id}:"
            f" {fleet.results[0].sentence}"
        )


def _workers(text: str) -> int:
    count = whole_number(text)
    if count is None or not 1 <= count <= 100_000:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a number of workers: write a whole number above 0, such as 8"
        )
    return count


def _memory(text: str) -> int:
    match = MEMORY.fullmatch(text.strip())
    if not match or not 0 < float(match[1]) < math.inf:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a size of memory: write a number with its unit, such as 4GB or"
            " 800MB"
        )
    return int(float(match[1]) * 1024 ** ("KMGT".index(match[2].upper()) + 1))
