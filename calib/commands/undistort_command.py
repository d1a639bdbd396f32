"""The command `calib undistort`."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from calib.commands.arguments import (
    add_calibration,
    add_crop,
    add_output,
    add_overwrite,
    calibration_files,
    check_depth_given,
    check_order,
    depth,
    quoted,
    two_numbers,
)
from calib.commands.loading import fast_imports
from calib.commands.printing import print_remark
from calib.commands.termination import exit_on_termination

if TYPE_CHECKING:
    from calib.calibration import Calibration
    from calib.progress import Progress

SUMMARY = "Undistort pictures, videos and ROS bags: remove the distortion of cover and lens."
DESCRIPTION = """
Pictures may be colour or grey, 8 or 16 bit. Pixels that the camera does not see through its cover
become 0. Videos lose their sound, and those of another type than avi, mp4, m4v, mov or mkv become
mp4. If a video is cut off, the command undistorts the frames that it has, and the exit code is 3.

In a ROS bag, the pictures of one topic are straightened. -o names the new file, .mcap, or .bag for
ROS 1. Its camera_info is that of the straight camera, whose place a static transform states. All
other messages are copied.
"""
EXAMPLES = (
    "calib undistort cam0/calibration photos --depth 1 -o straight",
    "calib undistort cam0/calibration film.mp4 --depth 0.5 --crop 0 -o straight",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "images",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="pictures, videos, folders of them, a pattern such as 'photos/*.jpg', or one bag",
    )
    how_far = parser.add_mutually_exclusive_group()
    how_far.add_argument(
        "--depth",
        type=depth,
        metavar="METRES",
        help="how far away the scene is, in metres; this or --depth-image is needed",
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
    how_far.add_argument(
        "--depth-topic",
        metavar="TOPIC",
        help=(
            "in a ROS bag, the topic with a depth for each pixel of the straightened pictures:"
            " 32FC1 metres or 16UC1 millimetres, raw or compressed"
        ),
    )
    parser.add_argument(
        "--near",
        type=depth,
        default=0.1,
        metavar="METRES",
        help="the smallest depth in depth images (default: 0.1 m)",
    )
    add_crop(parser)
    parser.add_argument(
        "--size",
        type=_size,
        metavar="WxH",
        help="size of the straightened pictures, in px (default: the camera's)",
    )
    parser.add_argument(
        "--colour",
        action="store_true",
        help=(
            "remove the colour fringes of the cover, each channel by its own index: session.yaml"
            " needs the glass's Abbe number"
        ),
    )
    parser.add_argument(
        "--topic",
        metavar="TOPIC",
        help="the topic of a ROS bag's pictures, such as /camera/image_raw, if there are several",
    )
    add_output(
        parser,
        "folder for the straightened files, which keep their names; for a ROS bag, the new file",
        required=True,
    )
    add_overwrite(parser)
    parser.usage = "%(prog)s CALIBRATION FILE ... --depth M -o DIR [options]"


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.apply.angular_reach import undistortion_limit
        from calib.apply.asked_depths import describe_all
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_paths
        from calib.errors import InputError, NotEnoughDataError
        from calib.io.bag_names import is_bag
        from calib.io.patterns import expand

    args.images = expand(args.images)
    bags = [path for path in args.images if is_bag(path)]
    for option, topic in (("--topic", args.topic), ("--depth-topic", args.depth_topic)):
        if topic and not bags:
            raise InputError(f"{option} is for a bag of ROS: leave it out, or give a bag.")
    if not bags:
        check_depth_given(args)
    if bags and len(args.images) > 1:
        raise InputError("A bag is undistorted by itself: give it alone.")
    check_order(args.calibration, args.images)
    calibration = Calibration.load(args.calibration)
    depths = [args.depth] if args.depth is not None else []
    for note in describe_all(calibration, depths):
        print_remark(note)
    with exit_on_termination(), Bars() as bars:
        paths, cut_off, remark = (_straighten_bag if bags else _straighten_files)(
            args, calibration, bars
        )
    print_paths(paths)
    if limit := undistortion_limit(calibration):
        print_remark(limit)
    if remark:
        print_remark(remark)
    if cut_off:
        count = len(cut_off) - 1
        addition = f" {count} more video{'s' * (count > 1)} of these break off." if count else ""
        raise NotEnoughDataError(cut_off[0] + addition)


class Straightened(NamedTuple):
    paths: Sequence[Path]
    """The written files."""
    cut_off: Sequence[str] = ()
    """A sentence for each video that is cut off."""
    remark: str = ""


def _straighten_files(
    args: argparse.Namespace, calibration: "Calibration", progress: "Progress"
) -> Straightened:
    from calib.apply.undistort_files import UndistortOptions, undistort_files
    from calib.errors import InputError
    from calib.io.folder_lock import hold_folder
    from calib.io.images import SUFFIXES
    from calib.io.output_folder import OutputFolder

    if args.output.suffix.lower() in SUFFIXES and not args.output.is_dir():
        raise InputError(
            f"-o is a folder, and {args.output.name} looks like a picture: write"
            f" -o {args.output.with_suffix('')}. Straight pictures keep their names."
        )

    wanted = UndistortOptions(
        args.depth if args.depth is not None else args.depth_image,
        args.crop,
        args.size,
        args.near,
        args.colour,
    )
    output = OutputFolder(
        args.output, overwrite=args.overwrite, inputs=calibration_files(args.calibration)
    )
    # what another process writes during the wait is not replaced: `output` does not list it
    with hold_folder(args.output, lambda: print_remark(_waiting(args.output))):
        done = undistort_files(calibration, args.images, wanted, output, progress)
    for sentence in done.left_out:
        print_remark(f"left out: {sentence}")
    remark = ""
    if args.depth is None and done.black == 1:
        remark = "Take care: the depth image has no depth, so the straight picture is black."
    if args.crop is None and args.depth is not None and done.black:
        remark = (
            f"{_percent(done.black)} of the straight picture is black: the camera does not see it."
            " Type --crop 0 for a picture with no black border."
        )
    return Straightened(done.paths, done.cut_off, remark)


def _waiting(folder: Path) -> str:
    return f"another calib writes to {folder}: this one waits until it has ended. Ctrl-C stops it."


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %" if fraction > 0.01 else "Less than 1 %"


def _straighten_bag(
    args: argparse.Namespace, calibration: "Calibration", progress: "Progress"
) -> Straightened:
    import numpy as np

    from calib.apply.colour import ColourUndistorter
    from calib.apply.undistorter import Undistorter
    from calib.errors import InputError
    from calib.export.straight_bag import straighten_bag
    from calib.io.depth_topic import LARGEST_GAP_S
    from calib.io.numerals import counted
    from calib.io.output_folder import ANOTHER_FILE, OutputFolder

    if args.depth is None and args.depth_topic is None:
        raise InputError(
            "A bag is undistorted at one depth, or by a topic of depth images: write --depth, in"
            " metres, or --depth-topic."
        )
    (path,) = args.images
    inputs = (path, *calibration_files(args.calibration))
    output = OutputFolder(
        args.output.absolute().parent,
        overwrite=args.overwrite,
        inputs=inputs,
        elsewhere=ANOTHER_FILE,
    )
    output.check([args.output.name])
    kind = ColourUndistorter if args.colour else Undistorter
    depth = args.depth
    if args.depth_topic:
        width, height = args.size or (calibration.camera.width, calibration.camera.height)
        depth = np.zeros((height, width), np.float32)
    undistorter = kind(calibration, depth, crop=args.crop, size=args.size, near=args.near)
    name = args.output.name
    written = straighten_bag(
        path, args.topic, undistorter, output, name, progress, args.depth_topic
    )
    for sentence in written.left_out:
        print_remark(sentence)
    if written.black:
        print_remark(
            f"Take care: without a depth of {args.near:g} m or more on {args.depth_topic}, the"
            f" result has {counted(written.black, 'black picture')}."
        )
    remark = ""
    if written.largest_gap_s > LARGEST_GAP_S:
        remark = (
            f"Take care: a picture is {written.largest_gap_s:.1f} s from its nearest depth image on"
            f" {args.depth_topic}."
        )
    return Straightened((args.output.parent / written.path.name,), remark=remark)


def _size(text: str) -> tuple[int, int]:
    size = two_numbers(text)
    if size is None or min(size) < 2 or max(size) > 32767:
        raise argparse.ArgumentTypeError(
            f"{quoted(text)} is not a size: write width and height in px, such as 1280x720"
        )
    return size
