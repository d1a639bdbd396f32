"""Calibrate a fleet: every camera fitted, checked against its prior, diagnosed where its verdict
asks for it, and exported.

MANIFEST is a CSV or YAML that lists cameras (id and session; serial, prior, fixture, date and
limits if there are), or sessions, such as 'sessions/*'. FLEET gets fleet.html, which shows who
stands out and why, fleet.csv, and for each camera a folder and a JSON in cameras/.

It runs on Dask: on this machine, at --scheduler, or as jobs of --jobqueue. What is done is not done
    again: where it was cut short, or a
session has changed, the same command goes on. Exit code 6: the cluster is gone before all was done.
"""

import argparse
import math
import re

from calib.commands.arguments import add_depths, add_output, quoted
from calib.commands.fit_options import add_fit_options, settings_of
from calib.errors import InputError, NotEnoughDataError
from calib.export.formats import FORMATS
from calib.fleet.cluster import QUEUES
from calib.io.numerals import whole_number

FOLDS = 4
"""Unless told otherwise: the held-out error is what cameras are compared by."""
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
    add_fit_options(parser, usual_folds=FOLDS)
    add_depths(parser, required=False)
    parser.add_argument(
        "--format",
        dest="formats",
        choices=[form.name for form in FORMATS],
        nargs="+",
        action="extend",
        default=[],
        help="export every camera that may be used, at every --depth, as calib export does",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="a Dask cluster that exists, such as tcp://head:8786",
    )
    where.add_argument(
        "--jobqueue",
        default="",
        choices=[*QUEUES],
        help="send workers as jobs of this queue, set up in dask-jobqueue's file",
    )
    parser.add_argument(
        "--workers",
        type=_workers,
        metavar="N",
        help="how many (default: one a core, as far as the memory reaches)",
    )
    parser.add_argument(
        "--memory", type=_memory, metavar="SIZE", help="what each worker may take, such as 4GB"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    import sys

    from calib.commands.batch_lines import fleet_json, print_fleet
    from calib.commands.console import Bars
    from calib.commands.printing import print_json
    from calib.fleet.batch import calibrate_fleet
    from calib.fleet.cluster import Place
    from calib.fleet.identity import Asked
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
    asked = Asked(settings_of(args), depths, formats)
    place = Place(args.scheduler, args.jobqueue, args.workers, args.memory)
    with Bars() as bars:
        fleet, written = calibrate_fleet(
            entries,
            asked,
            args.output.absolute(),
            place,
            bars,
            lambda line: print(line, file=sys.stderr),
        )
    if args.json:
        print_json(fleet_json(fleet, written))
    else:
        print_fleet(fleet, written)
    if not any(result.verdict for result in fleet.results):
        raise NotEnoughDataError(
            f"No camera is calibrated, of {fleet.results[0].id} for one:"
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
