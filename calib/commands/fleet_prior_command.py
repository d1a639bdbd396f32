"""The command `calib fleet-prior`."""

import argparse
from pathlib import Path

from calib.commands.arguments import add_overwrite

SUMMARY = "Make a prior for the next camera of a make, so that it needs fewer pictures."
DESCRIPTION = """
FLEET is a folder that calib batch wrote. The prior holds every number of camera and cover that its
fits estimated: the mean over the cameras, and how much cameras differ beyond the uncertainty of
each fit. Cameras that are broken or stand out are left out and named.

A session uses the prior by a line in session.yaml, a path relative to its folder:
prior: ../prior.yaml
"""
EXAMPLES = (
    "calib fleet-prior fleet -o prior.yaml",
    "calib fleet-prior fleet -o prior.yaml --json",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "fleet", type=Path, metavar="FLEET", help="the folder that calib batch wrote"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="PRIOR",
        help="the file to write, such as prior.yaml",
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from calib.commands.fleet_prior_lines import print_prior, prior_json
    from calib.commands.printing import print_json
    from calib.fleet.prior import estimate_fleet_prior
    from calib.fleet.result import fleet_files
    from calib.io.output_folder import ANOTHER_FILE, OutputFolder
    from calib.session.fleet_prior import fleet_prior_yaml
    from calib.version import VERSION

    output = OutputFolder(
        args.output.parent,
        overwrite=args.overwrite,
        inputs=fleet_files(args.fleet),
        elsewhere=ANOTHER_FILE,
    )
    output.check([args.output.name])
    prior = estimate_fleet_prior(args.fleet)
    output.write(args.output.name, fleet_prior_yaml(prior, VERSION))
    if args.json:
        print_json(prior_json(prior, args.output))
    else:
        print_prior(prior, args.output)
