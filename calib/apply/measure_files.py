"""The files of `calib measure`: the pixels to measure, and the poses of views. They are CSV with a
header line; lines that begin with # are ignored.

name,image,x,y                    name and image are optional where nothing needs them; x,y px
image,rx,ry,rz,tx,ty,tz           T_camera_board: rotation vector, rad, and translation, m
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.apply.measure import BoardPose, MeasuredPoints, Measurer
from calib.calibration import Calibration
from calib.corners.detection import NotFound
from calib.corners.find import find_board
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief
from calib.io.files import MAX_TEXT_BYTES, read_file, reading
from calib.io.images import SUFFIXES, read_grey
from calib.progress import Progress
from calib.undistortion.grids import Array

POSE = ("rx", "ry", "rz", "tx", "ty", "tz")


@dataclass(frozen=True, slots=True)
class Point:
    """A pixel to measure."""

    name: str
    image: str
    """The name of its picture; empty if the file has none."""
    x: float
    y: float


def read_points(path: Path) -> list[Point]:
    """Return the pixels of a file; InputError if it is not such a table."""
    rows = _read_table(path, ("x", "y"), ("name", "image"))
    return [
        Point(cells.get("name") or str(n), cells.get("image", ""), *numeric)
        for n, (cells, numeric) in enumerate(rows, start=1)
    ]


def read_poses(path: Path) -> dict[str, BoardPose]:
    """Return the board's pose for each picture; InputError if the file is not such a table."""
    return {
        cells["image"]: BoardPose.exactly(np.array(numeric))
        for cells, numeric in _read_table(path, POSE, ("image",))
    }


def measure_at_depth(measurer: Measurer, points: Sequence[Point], depth: float) -> MeasuredPoints:
    """Return the points on a plane perpendicular to the optical axis, at a depth in m, in the
    camera frame.

    Raises:
        InputError: the depth is infinite, or lies inside the cover.
    """
    if math.isinf(depth):
        raise InputError("points at infinity have no place: write a depth in metres, such as 0.8.")
    measurer.calibration.ray_field().check_reach(depth)
    return measurer.on_planes(_pixels(points), [BoardPose.facing(depth)], [0] * len(points))


def measure_on_boards(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    poses: dict[str, BoardPose],
    progress: Progress,
) -> MeasuredPoints:
    """Return each point on the plane of the board in its picture, in the camera frame. The boards
    are detected in the pictures of the folder if no poses are given.
    """
    boards = _board_poses(measurer, points, folder, poses, progress)
    names = list(boards)
    return measurer.on_planes(
        _pixels(points), list(boards.values()), [names.index(point.image) for point in points]
    )


def measure_by_rays(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    poses: dict[str, BoardPose],
    progress: Progress,
) -> tuple[list[str], MeasuredPoints]:
    """Return the names of the points, and the points, triangulated from the pixels of one name in
    two or more pictures, in the frame of the board that all these pictures show.

    Raises:
        NotEnoughDataError: a point is in one picture only.
    """
    names = list(dict.fromkeys(point.name for point in points))
    for name in names:
        if len({point.image for point in points if point.name == name}) < 2:
            raise NotEnoughDataError(
                f"{brief(name)} is in one picture only: give its pixel in another as well, or"
                " measure on a plane."
            )
    boards = _board_poses(measurer, points, folder, poses, progress)
    images = list(boards)
    if not poses:
        boards = _in_one_frame(measurer, points, folder, boards)
    point_indices = [names.index(point.name) for point in points]
    return names, measurer.triangulate(
        _pixels(points),
        list(boards.values()),
        [images.index(p.image) for p in points],
        point_indices,
    )


def _in_one_frame(
    measurer: Measurer, points: Sequence[Point], folder: Path, boards: dict[str, BoardPose]
) -> dict[str, BoardPose]:
    """Return the poses of the boards in one common frame. A checkerboard looks the same when it is
    rotated by half a turn, so the corners of each picture are put in the order in which its rays
    meet the rays of the first picture best.
    """
    images = list(boards)
    first = images[0]
    first_board = boards[first]
    chosen = {first: first_board}
    for image in images[1:]:
        common = sorted(
            {p.name for p in points if p.image == first}
            & {p.name for p in points if p.image == image}
        )
        pair = [p for p in points if p.name in common and p.image in (first, image)]
        point_indices = [common.index(p.name) for p in pair]
        view_indices = [int(p.image == image) for p in pair]
        views = views_in_each_order(
            _detect_view(measurer.calibration, folder / image), measurer.calibration
        )
        candidates = [measurer.board_pose(view) for view in views]
        if not pair:
            chosen[image] = boards[image]
            continue
        results = [
            measurer.triangulate(
                _pixels(pair), [first_board, candidate], view_indices, point_indices
            )
            for candidate in candidates
        ]
        gaps = [np.nansum(result.gap_px) for result in results]
        failures = [np.isnan(result.points).sum() for result in results]
        chosen[image] = candidates[int(np.lexsort((gaps, failures))[0])]
    return chosen


def views_in_each_order(view: View, calibration: Calibration) -> list[View]:
    """Return the view with its corners in each order that the board's pattern allows."""
    board = calibration.board
    if board.coding:
        return [view]
    corners = view.corners.reshape(board.rows, board.columns, -1)
    weight = view.weight.reshape(board.rows, board.columns, -1)
    quarters = range(4) if board.rows == board.columns else (0, 2)
    return [
        View(
            view.name, np.rot90(corners, quarter).reshape(-1, 2), np.rot90(weight, quarter).ravel()
        )
        for quarter in quarters
    ]


def _board_poses(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    poses: dict[str, BoardPose],
    progress: Progress,
) -> dict[str, BoardPose]:
    """Return the board's pose for every picture that has a point. Detect it if none is given."""
    images = list(dict.fromkeys(point.image for point in points))
    if "" in images:
        raise InputError("the points do not say in which picture they are: add a column `image`.")
    advance = progress.task("Boards", len(images))
    boards = {}
    for done, image in enumerate(images):
        advance(done, image)
        if poses and image not in poses:
            raise InputError(
                f"the poses do not name {brief(image)}: add a line for it, or leave --poses out so"
                " that its board is looked for."
            )
        boards[image] = (
            poses[image]
            if poses
            else measurer.board_pose(_detect_view(measurer.calibration, folder / image))
        )
    advance(len(images), "")
    return boards


def _detect_view(calibration: Calibration, path: Path) -> View:
    grey, camera, board = read_grey(path), calibration.camera, calibration.board
    if grey.shape != (camera.height, camera.width):
        raise InputError(
            f"{path} is {grey.shape[1]}x{grey.shape[0]} px where the calibration is for"
            f" {camera.width}x{camera.height}."
        )
    detection = find_board(grey, board)
    if isinstance(detection, NotFound):
        raise NotEnoughDataError(
            f"{path}: {detection.reason}; or take another picture, or give the pose with --poses."
        )
    return View(
        path.name, detection.corners, np.isfinite(detection.corners[:, 0]).astype(np.float64)
    )


def _pixels(points: Sequence[Point]) -> Array:
    return np.array([(point.x, point.y) for point in points])


def _read_table(
    path: Path, number_columns: tuple[str, ...], text_columns: tuple[str, ...]
) -> list[tuple[dict[str, str], list[float]]]:
    """Return the cells of the text columns, and the values of the number columns, of each line.

    Raises:
        InputError: the file is not such a table, or has no line.
    """
    columns = ",".join((*text_columns, *number_columns))
    with reading(path):
        is_folder = path.is_dir()
    if is_folder or path.suffix.lower() in SUFFIXES:
        kind = "folder" if is_folder else "picture"
        raise InputError(f"{path} is a {kind}: give a CSV file that begins with {columns}.")
    try:
        text = read_file(path, MAX_TEXT_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file: write CSV in UTF-8.") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        reader = csv.reader(lines, skipinitialspace=True)
        header = [name.strip().lower() for name in next(reader, ())]
        table = [dict(zip(header, cells, strict=False)) for cells in reader]
    except csv.Error as error:
        raise InputError(
            f"{path} is not a CSV table ({error}): write a line of {columns} for each entry."
        ) from error
    if len(header) == 1 and (separator := re.search(r"[;\t ]", header[0])):
        name = {";": "semicolons", "\t": "tabs", " ": "blanks"}[separator[0]]
        raise InputError(f"{path} has {name} between its columns: write commas.")
    if missing := [name for name in number_columns if name not in header]:
        raise InputError(
            f"{path} has no column {missing[0]}: begin it with a line such as {columns}."
        )
    rows: list[tuple[dict[str, str], list[float]]] = []
    for row in table:
        try:
            values = [float(row[name]) for name in number_columns]
        except (LookupError, ValueError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise InputError(
                f"{path}, entry {len(rows) + 1}: {', '.join(number_columns)} are not all numbers:"
                " correct that line."
            )
        rows.append(({name: row.get(name, "").strip() for name in text_columns}, values))
    if not rows:
        raise InputError(f"{path} holds no entry: write a line for each below the header.")
    return rows
