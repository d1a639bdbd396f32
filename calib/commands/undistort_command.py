"""The command `calib undistort`."""

import argparse
import sys
from pathlib import Path

from calib.commands.arguments import (
    add_calibration,
    add_output,
    add_overwrite,
    calibration_files,
    depth,
    quoted,
    two_numbers,
)
from calib.commands.loading import fast_imports

SUMMARY = "Undistort pictures and videos: remove the distortion of cover and lens."
DESCRIPTION = """
Pictures may be colour or grey, 8 or 16 bit. Pixels that the camera does not see through its cover
become 0. Videos lose their sound. If a video is cut off, the command undistorts the frames that it
has, and the exit code is 3.
"""
EXAMPLES = (
    "calib undistort cam0/calibration photos --depth 1 -o straight",
    "calib undistort cam0/calibration film.mp4 --depth 0.5 --crop 0 -o straight",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "images", type=Path, nargs="+", metavar="FILE", help="pictures, videos, or folders of them"
    )
    how_far = parser.add_mutually_exclusive_group(required=True)
    how_far.add_argument(
        "--depth", type=depth, metavar="M", help="how far away the scene is, in metres"
    )
    how_far.add_argument(
        "--depth-image",
        type=Path,
        metavar="FILE",
        help=(
            "a depth for each pixel of the straightened picture: floating-point metres (npy, tiff)"
            " or 16-bit millimetres (png), 0 where unknown; or a folder with one for each picture,"
            " under its name"
        ),
    )
    parser.add_argument(
        "--near",
        type=depth,
        default=0.1,
        metavar="M",
        help="the smallest depth in depth images (default: 0.1 m)",
    )
    parser.add_argument(
        "--crop",
        type=crop_alpha,
        metavar="ALPHA",
        help=(
            "0: only valid pixels; 1: everything that the camera sees (default: the camera's focal"
            " length)"
        ),
    )
    parser.add_argument(
        "--size",
        type=_size,
        metavar="WxH",
        help="size of the straightened pictures, in px (default: the camera's)",
    )
    add_output(parser, "folder for the straightened files, which keep their names", required=True)
    add_overwrite(parser)


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.apply.angular_reach import undistortion_limit
        from calib.apply.undistort_files import UndistortOptions, undistort_files
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_paths
        from calib.errors import NotEnoughDataError
        from calib.io.output_folder import OutputFolder

    calibration = Calibration.load(args.calibration)
    wanted = UndistortOptions(
        args.depth if args.depth is not None else args.depth_image, args.crop, args.size, args.near
    )
    output = OutputFolder(
        args.output, overwrite=args.overwrite, inputs=calibration_files(args.calibration)
    )
    with Bars() as bars:
        done = undistort_files(calibration, args.images, wanted, output, bars)
    print_paths(done.paths)
    if limit := undistortion_limit(calibration):
        print(limit, file=sys.stderr)
    if done.cut_off:
        count = len(done.cut_off) - 1
        addition = f" {count} more video{'s' * (count > 1)} of these break off." if count else ""
        raise NotEnoughDataError(done.cut_off[0] + addition)


def crop_alpha(text: str) -> float:
    try:
        alpha = float(text)
    except ValueError:
        alpha = -1.0
    if not 0 <= alpha <= 1:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not from 0 to 1: write 0 for valid pixels only, 1 for all that the"
            " camera sees"
        )
    return alpha


def _size(text: str) -> tuple[int, int]:
    size = two_numbers(text)
    if size is None or min(size) < 2 or max(size) > 32767:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a size: write width and height in px, such as 1280x720"
        )
    return size
