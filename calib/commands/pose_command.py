"""The command `calib pose`."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import (
    add_calibration,
    add_overwrite,
    calibration_files,
    doubt_unit,
    millimetres,
    positive_or_zero,
)
from calib.commands.loading import fast_imports
from calib.errors import brief, harmless
from calib.rounding import to_digit_of

if TYPE_CHECKING:
    from rich.console import Console

    from calib.apply.located_tags import TagPose
    from calib.apply.tag_files import Refused, TagPicture
    from calib.apply.tags import TagLocator

SUMMARY = "Locate AprilTags and ArUco markers in pictures: poses in metres, with sigma."
DESCRIPTION = """
PICTURES are the original pictures of the camera, through its cover. The pose of a tag is solved on
the calibrated rays, which do not meet in one point. It is given in the camera frame (x right, y
down, z forward): the middle of the tag, and the rotation vector of the tag's frame, whose x
points to the right of the upright tag, y down, and z away from the viewer. AprilTags are upright as
their makers print them. A small tag in front view may fit two poses: the command gives both, with
their probabilities.

Sigma includes the noise of the corners, the uncertainty of the calibrated rays, and the uncertainty
of the tags' side. It does not include a tag that is not flat.
"""
EXAMPLES = (
    "calib pose cam0/calibration photos --tags DICT_APRILTAG_36h11 --size-mm 40",
    "calib pose cam0/calibration a.png --tags DICT_4X4_50 --size-mm 25 -o tags.csv",
)

BORDERS = (1, 2)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "pictures", type=Path, nargs="+", metavar="PICTURES", help="pictures, or folders of them"
    )
    dictionary = "the tags' dictionary, as OpenCV calls it: DICT_APRILTAG_36h11, DICT_4X4_50 ..."
    parser.add_argument("--tags", required=True, metavar="DICTIONARY", help=dictionary)
    parser.add_argument(
        "--size-mm",
        type=millimetres,
        required=True,
        metavar="S",
        help="side of the tags' black square, in mm",
    )
    sigma = "standard deviation of the side, in mm; 0 if it is exact (default: 0.2 %% of the side)"
    parser.add_argument("--size-sigma-mm", type=positive_or_zero, metavar="S", help=sigma)
    border = "black cells around a tag's bits; Kalibr's tags have 2 (default: 1)"
    parser.add_argument("--border", type=int, choices=BORDERS, default=1, metavar="N", help=border)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="a CSV table of all poses, with their covariances",
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.apply.tag_files import as_table, locate_in_files, pictures_of
        from calib.apply.tags import TagLocator
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, print_paths, print_remark
        from calib.io.files import check_writable
        from calib.io.output_folder import ANOTHER_FILE, OutputFolder
        from calib.io.patterns import expand

    if doubt := doubt_unit("--size-mm", args.size_mm):
        print_remark(doubt)
    sigma = None if args.size_sigma_mm is None else args.size_sigma_mm / 1000
    locator = TagLocator(
        Calibration.load(args.calibration), args.tags, args.size_mm / 1000, sigma, args.border
    )
    paths = pictures_of(expand(args.pictures))
    if args.output:
        check_writable(args.output.parent)
        output = OutputFolder(
            args.output.parent,
            overwrite=args.overwrite,
            inputs=[*calibration_files(args.calibration), *paths],
            elsewhere=ANOTHER_FILE,
        )
        output.check([args.output.name])
    with Bars() as bars:
        pictures, refused = locate_in_files(locator, paths, bars)
    for picture in refused:
        print_remark(f"left out: {picture.sentence}")
    written = [args.output] if args.output else []
    if args.output:
        output.write(args.output.name, as_table(pictures))
    if args.json:
        print_json(_as_mapping(locator, pictures, refused, written))
    else:
        _print(pictures)
        print_paths(written)


def _as_mapping(
    locator: "TagLocator",
    pictures: "Sequence[TagPicture]",
    refused: "Sequence[Refused]",
    written: Sequence[Path],
) -> dict[str, object]:
    return {
        "frame": "camera",
        "dictionary": locator.dictionary,
        "size_mm": 1000 * locator.side,
        "pictures": [
            {
                "picture": str(picture.path),
                "tags": [
                    {
                        "id": tag.number,
                        "ambiguous": tag.ambiguous,
                        "corners_px": tag.corners.tolist(),
                        "poses": [_pose(pose) for pose in tag.poses],
                    }
                    for tag in picture.located.tags
                ],
                "growth_px": {
                    "value": picture.located.growth.px,
                    "sigma": picture.located.growth.sigma,
                },
                "not_placed": [
                    {"id": tag.number, "reason": str(tag.reason)}
                    for tag in picture.located.unplaced
                ],
            }
            for picture in pictures
        ],
        "left_out": [{"picture": str(file.path), "reason": file.sentence} for file in refused],
        "written": [str(path) for path in written],
    }


def _pose(pose: "TagPose") -> dict[str, object]:
    sigma = pose.sigma.tolist()
    return {
        "probability": pose.probability,
        "m": pose.position.tolist(),
        "sigma_m": sigma[3:],
        "rotation_rad": pose.rotation.tolist(),
        "sigma_turn_rad": sigma[:3],
        "quaternion_xyzw": pose.quaternion.tolist(),
        "covariance": pose.covariance.tolist(),
        "off_px": pose.off_px,
    }


def _print(pictures: "Sequence[TagPicture]") -> None:
    import numpy as np
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    for picture in pictures:
        located = picture.located
        if located.tags:
            title = Text(f"{brief(picture.path)}: in the camera frame, ± sigma")
            head = ("tag", "x, mm", "y, mm", "z, mm", "±", "turn, degrees", "±", "off, px")
            table = Table(
                *head, title=title, box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0)
            )
            for column in table.columns[1:]:
                column.justify = "right"
            for tag in located.tags:
                for pose in tag.poses if tag.ambiguous else tag.poses[:1]:
                    name = (
                        f"{tag.number} ({pose.probability:.0%})"
                        if tag.ambiguous
                        else str(tag.number)
                    )
                    *position, position_sigma = _rounded(
                        (1000 * pose.position).tolist(), 1000 * float(pose.sigma[3:].max())
                    )
                    *rotation, rotation_sigma = _rounded(
                        np.degrees(pose.rotation).tolist(), math.degrees(pose.sigma[:3].max())
                    )
                    table.add_row(
                        name,
                        *position,
                        position_sigma,
                        " ".join(rotation),
                        rotation_sigma,
                        f"{pose.off_px:.3f}",
                    )
            console.print(table)
        _print_remarks(console, picture)


def _rounded(numbers: list[float], sigma: float) -> list[str]:
    """Return the numbers and their largest sigma, rounded to its second digit."""
    return [to_digit_of(number, sigma) for number in (*numbers, sigma)]


def _print_remarks(console: "Console", picture: "TagPicture") -> None:
    """Print a sentence for each tag without a pose, or with two poses."""
    growth = picture.located.growth
    lines = []
    if growth.px:
        lines = [
            f"Black looks {2 * abs(growth.px):.2f} px {'wider' if growth.px > 0 else 'narrower'}"
            " than it is; that is taken off."
        ]
    lines += [f"Not placed: tag {tag.number}, {tag.reason}." for tag in picture.located.unplaced]
    lines += [
        f"Ambiguous: tag {tag.number} may have either of two poses: show it larger, or less from"
        " the front."
        for tag in picture.located.tags
        if tag.ambiguous
    ]
    if not (picture.located.unplaced or picture.located.tags):
        lines = ["no tag is seen."]
    for line in lines:
        console.print(
            harmless(f"{picture.path}: {line}"), markup=False, highlight=False, soft_wrap=True
        )
