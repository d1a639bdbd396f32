"""Straighten pictures: show the scene at one depth as the camera would without its cover and lens distortion.

Colour and grey, 8 and 16 bit. Pixels that the camera does not see through its cover become 0.
"""

import argparse
from pathlib import Path

from calib.commands.arguments import add_calibration, add_output, depth


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help="pictures, or folders of them")
    parser.add_argument("--depth", type=depth, required=True, metavar="M", help="how far away the scene is, in metres")
    add_output(parser, "where the straightened pictures go, under their own names", required=True)


def run(args: argparse.Namespace) -> None:
    from calib.calibration import Calibration
    from calib.console import Bars
    from calib.undistort import undistort_files

    calibration = Calibration.load(args.calibration)
    with Bars() as bars:
        written = undistort_files(calibration, args.images, args.depth, args.output, bars)
    print(*written, sep="\n")
