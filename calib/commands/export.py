"""Write a calibration in a form that other programs read.

npz: the ray field, from which any depth's map follows without the model, and for every --depth the two maps of cv2.remap with a mask
of the pixels that the camera sees.
"""

import argparse

from calib.commands.arguments import add_calibration, add_depths, add_output


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument("--format", choices=["npz"], required=True, help="the form")
    add_depths(parser, required=False)
    add_output(parser, "where the files go", required=True)


def run(args: argparse.Namespace) -> None:
    from calib.calibration import Calibration
    from calib.console import Bars
    from calib.export.npz import write_npz

    calibration = Calibration.load(args.calibration)
    with Bars() as bars:
        written = write_npz(calibration, args.depth, args.output, bars)
    print(*written, sep="\n")
