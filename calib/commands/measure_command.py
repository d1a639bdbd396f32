"""The command `calib measure`."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import add_calibration, check_order, depth, positive_number
from calib.commands.loading import fast_imports
from calib.errors import NotEnoughDataError, brief, harmless
from calib.rounding import with_sigma

if TYPE_CHECKING:
    from calib.apply.measure import MeasuredPoints

SUMMARY = "Measure in metres: points on a plane, or points that several pictures show, and lengths."
DESCRIPTION = """
POINTS is a CSV file with the columns x,y (px in the original pictures), and optionally name and
image. Points lie on a plane at right angles to the optical axis (--depth), on the board that their
picture shows (--on-boards), or where the rays of the same name from two or more pictures of one
still board meet (--triangulate). The pictures lie in the folder of POINTS. A point outside its
picture, or without a ray, is not measured; the table and the JSON say why.

Sigma includes the noise of the pixels, the uncertainty of the calibrated rays, the corner noise of
the boards, and the uncertainty of the squares' side (board.square_mm; 0.2 % if session.yaml gives
none). It does not include a board of another shape, or glass that the fit cannot follow.
"""
EXAMPLES = (
    "calib measure cam0/calibration points.csv --depth 0.8",
    "calib measure cam0/calibration points.csv --triangulate",
)

NO_SIGMA = 5e-10
"""m: a smaller standard deviation is rounding, of a coordinate that is given."""
CLICK_NOISE_PX = 0.5
"""px, per axis: a person points to the middle of a pixel, or to the next one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument("points", type=Path, metavar="POINTS", help="a CSV file of pixels")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--depth", type=depth, metavar="METRES", help="how far away the plane is, in metres"
    )
    where.add_argument(
        "--on-boards",
        action="store_true",
        help="each point lies on the board in its picture; in the camera frame",
    )
    where.add_argument(
        "--triangulate",
        action="store_true",
        help="points of the same name are one point; in the board's frame",
    )
    poses = (
        "a CSV file of T_camera_board for each picture, image,rx,ry,rz,tx,ty,tz in rad and m,"
        " instead of the detection of boards"
    )
    parser.add_argument("--poses", type=Path, metavar="FILE", help=poses)
    noise = (
        f"noise of the given pixels, per axis (default: {CLICK_NOISE_PX:g}, of a person's clicks; a"
        " detector's corners have a tenth of it)"
    )
    parser.add_argument(
        "--noise", type=positive_number, metavar="PX", default=CLICK_NOISE_PX, help=noise
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    with fast_imports():
        from calib.apply.asked_depths import describe_depths
        from calib.apply.measure import Measurer
        from calib.apply.measure_files import (
            measure_at_depth,
            measure_by_rays,
            measure_on_boards,
            read_points,
            read_poses,
        )
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, print_remark

    check_order(args.calibration, [args.points])
    calibration = Calibration.load(args.calibration)
    points = read_points(args.points)
    poses = read_poses(args.poses) if args.poses else {}
    measurer = Measurer(calibration, args.noise)
    names = [point.name for point in points]
    folder = args.points.parent
    with Bars() as bars:
        if args.depth is not None:
            measured = measure_at_depth(measurer, points, args.depth)
            for remark in describe_depths(calibration, [args.depth]):
                print_remark(remark)
        elif args.on_boards:
            measured = measure_on_boards(measurer, points, folder, poses, bars)
        else:
            names, measured = measure_by_rays(measurer, points, folder, poses, bars)
    frame = "board" if args.triangulate else "camera"
    if args.json:
        print_json(_as_mapping(names, measured, frame, measurer.noise_px))
    else:
        _print(names, measured, frame, measurer.noise_px)
    if all(measured.reasons):
        raise NotEnoughDataError(f"No point was measured: {measured.reasons[0]}.")


def _as_mapping(
    names: list[str], measured: "MeasuredPoints", frame: str, noise_px: float
) -> dict[str, object]:
    rows = zip(
        names,
        measured.points.tolist(),
        measured.sigma.tolist(),
        measured.gap_px.tolist(),
        measured.reasons,
        strict=True,
    )
    return {
        "frame": frame,
        "noise_px": noise_px,
        "points": [
            {"name": name, "m": at, "sigma_m": sigma, "gap_px": gap, "reason": reason or None}
            for name, at, sigma, gap, reason in rows
        ],
        "distances": [
            {"from": names[i], "to": names[i + 1], "m": metres, "sigma_m": sigma}
            for i, (metres, sigma) in enumerate(
                measured.distance(i, i + 1) for i in range(len(names) - 1)
            )
        ],
    }


def _print(names: list[str], measured: "MeasuredPoints", frame: str, noise_px: float) -> None:
    import numpy as np
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    title = f"In the {frame} frame, mm ± sigma"
    table = Table(
        "point",
        "x",
        "y",
        "z",
        "to the next",
        title=title,
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for i, (name, at, sigma) in enumerate(zip(names, measured.points, measured.sigma, strict=True)):
        cells = [_cell(value, spread) for value, spread in zip(at, sigma, strict=True)]
        table.add_row(
            Text(brief(name)),
            *cells,
            _cell(*measured.distance(i, i + 1)) if i + 1 < len(names) else "",
        )
    console.print(table)
    for name, reason in zip(names, measured.reasons, strict=True):
        if reason:
            console.print(
                harmless(f"Not measured: {name}: {reason}."),
                markup=False,
                highlight=False,
                soft_wrap=True,
            )
    if frame == "board" and np.isfinite(measured.gap_px).any():
        console.print(
            f"The rays miss their points by {np.nanmax(measured.gap_px):.2f} px at most, root mean"
            " square of each point."
        )
    console.print(f"Pixel noise {noise_px:.3f} px per axis.")


def _cell(metres: float, sigma: float) -> str:
    """Return the length in mm ± sigma. A declared coordinate has no sigma."""
    if not (math.isfinite(metres) and math.isfinite(sigma)):
        return "-"
    if sigma <= 0:
        return f"{1000 * metres:g}"
    if sigma < NO_SIGMA:
        return f"{1000 * metres:.6f}".rstrip("0").rstrip(".")
    return with_sigma(1000 * metres, 1000 * sigma)
