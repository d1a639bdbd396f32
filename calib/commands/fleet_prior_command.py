"""Write the prior that a fleet gives for the next camera of its make, which then takes fewer
pictures.

FLEET is the folder that calib batch wrote. The prior has every number of camera and cover that the
fits estimated: its mean over the cameras and their spread, without the fits' own uncertainty.
Cameras that are broken or do not fit the others are left out, and named.

A session names the prior in session.yaml, relative to its folder: prior: ../prior.yaml
"""

import argparse
from pathlib import Path


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
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from calib.commands.fleet_prior_lines import print_prior, prior_json
    from calib.commands.printing import print_json
    from calib.fleet.prior import fleet_prior
    from calib.io.files import write_atomically
    from calib.session.fleet_prior import fleet_prior_yaml
    from calib.version import VERSION

    prior = fleet_prior(args.fleet)
    write_atomically(args.output, fleet_prior_yaml(prior, VERSION))
    if args.json:
        print_json(prior_json(prior, args.output))
    else:
        print_prior(prior, args.output)
