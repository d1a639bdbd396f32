"""The files of `calib measure`: pixels to measure, and poses of views. CSV with a header line;
lines that begin with # are left out.

name,image,x,y                    name,image are optional where nothing needs them; x,y px
image,rx,ry,rz,tx,ty,tz           T_camera_board: rotation vector, rad, and translation, m
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.apply.measure import BoardPose, Measured, Measurer
from calib.calibration import Calibration
from calib.corners.detection import NotFound
from calib.corners.find import find_board
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief
from calib.io.files import MOST_TEXT, read_file
from calib.io.images import read_grey
from calib.progress import Progress
from calib.undistortion.grids import Array

POSE = ("rx", "ry", "rz", "tx", "ty", "tz")


@dataclass(frozen=True, slots=True)
class Point:
    """A pixel to measure."""

    name: str
    image: str
    """The picture it is in; empty where the file does not say."""
    x: float
    y: float


def read_points(path: Path) -> list[Point]:
    rows = _read(path, ("x", "y"), ("name", "image"))
    return [
        Point(said.get("name") or str(n), said.get("image", ""), *numeric)
        for n, (said, numeric) in enumerate(rows, start=1)
    ]


def read_poses(path: Path) -> dict[str, BoardPose]:
    """By picture."""
    return {
        said["image"]: BoardPose.exactly(np.array(numeric))
        for said, numeric in _read(path, POSE, ("image",))
    }


def measure_at_depth(measurer: Measurer, points: Sequence[Point], depth: float) -> Measured:
    return measurer.on_planes(_pixels(points), [BoardPose.facing(depth)], [0] * len(points))


def measure_on_boards(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    given: dict[str, BoardPose],
    progress: Progress,
) -> Measured:
    """Each point on the board that its own picture shows; all in the camera frame."""
    boards = _boards(measurer, points, folder, given, progress)
    names = list(boards)
    return measurer.on_planes(
        _pixels(points), list(boards.values()), [names.index(point.image) for point in points]
    )


def measure_by_rays(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    given: dict[str, BoardPose],
    progress: Progress,
) -> tuple[list[str], Measured]:
    """The points that two or more pictures show under one name, in the frame of the board that is
    in all of these pictures.
    """
    names = list(dict.fromkeys(point.name for point in points))
    for name in names:
        if len({point.image for point in points if point.name == name}) < 2:
            raise NotEnoughDataError(
                f"{brief(name)} is in one picture only: give its pixel in another as well, or"
                " measure on a plane."
            )
    boards = _boards(measurer, points, folder, given, progress)
    images = list(boards)
    if not given:
        boards = _alike(measurer, points, folder, boards)
    which = [names.index(point.name) for point in points]
    return names, measurer.triangulate(
        _pixels(points), list(boards.values()), [images.index(p.image) for p in points], which
    )


def _alike(
    measurer: Measurer, points: Sequence[Point], folder: Path, boards: dict[str, BoardPose]
) -> dict[str, BoardPose]:
    """The same boards with one frame: a checkerboard looks the same turned about, so each is turned
    to where rays meet the first's best.
    """
    (first, held), *rest = boards.items()
    chosen = {first: held}
    for image, found in rest:
        both = sorted(
            {p.name for p in points if p.image == first}
            & {p.name for p in points if p.image == image}
        )
        some = [p for p in points if p.name in both and p.image in (first, image)]
        which, view = [both.index(p.name) for p in some], [int(p.image == image) for p in some]
        tried = [
            measurer.board_pose(turned)
            for turned in turned_views(
                _view(measurer.calibration, folder / image), measurer.calibration
            )
        ]
        gaps = [
            (
                np.nansum(measurer.triangulate(_pixels(some), [held, one], view, which).gap_px)
                if some
                else 0.0
            )
            for one in tried
        ]
        wild = [
            (
                np.isnan(measurer.triangulate(_pixels(some), [held, one], view, which).points).sum()
                if some
                else 0
            )
            for one in tried
        ]
        chosen[image] = tried[int(np.lexsort((gaps, wild))[0])] if some else found
    return chosen


def turned_views(view: View, calibration: Calibration) -> list[View]:
    """The orders of its corners that the board's pattern allows."""
    board = calibration.board
    if board.coding:
        return [view]
    corners, weight = (
        part.reshape(board.rows, board.columns, -1) for part in (view.corners, view.weight)
    )
    quarters = range(4) if board.rows == board.columns else (0, 2)
    return [
        View(
            view.name, np.rot90(corners, quarter).reshape(-1, 2), np.rot90(weight, quarter).ravel()
        )
        for quarter in quarters
    ]


def _boards(
    measurer: Measurer,
    points: Sequence[Point],
    folder: Path,
    given: dict[str, BoardPose],
    progress: Progress,
) -> dict[str, BoardPose]:
    """Of every picture in which there is a point."""
    images = list(dict.fromkeys(point.image for point in points))
    if "" in images:
        raise InputError("the points do not say in which picture they are: add a column `image`.")
    advance = progress.task("Boards", len(images))
    boards = {}
    for done, image in enumerate(images):
        advance(done, image)
        if given and image not in given:
            raise InputError(
                f"the poses do not name {brief(image)}: add a line for it, or leave --poses out so"
                " that its board is looked for."
            )
        boards[image] = (
            given[image]
            if given
            else measurer.board_pose(_view(measurer.calibration, folder / image))
        )
    advance(len(images), "")
    return boards


def _view(calibration: Calibration, path: Path) -> View:
    grey, camera, board = read_grey(path), calibration.camera, calibration.board
    if grey.shape != (camera.height, camera.width):
        raise InputError(
            f"{path} is {grey.shape[1]}x{grey.shape[0]} px where the calibration is for"
            f" {camera.width}x{camera.height}."
        )
    found = find_board(grey, board)
    if isinstance(found, NotFound):
        raise NotEnoughDataError(
            f"{path}: {found.reason}; or take another picture, or give the pose with --poses."
        )
    return View(path.name, found.corners, np.isfinite(found.corners[:, 0]).astype(np.float64))


def _pixels(points: Sequence[Point]) -> Array:
    return np.array([(point.x, point.y) for point in points])


def _read(
    path: Path, numeric: tuple[str, ...], words: tuple[str, ...]
) -> list[tuple[dict[str, str], list[float]]]:
    """Each line's words, and its parameters in order."""
    try:
        text = read_file(path, MOST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file: write CSV in UTF-8.") from error
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        reader = csv.reader(lines, skipinitialspace=True)
        header = [name.strip() for name in next(reader, ())]
        table = [dict(zip(header, cells, strict=False)) for cells in reader]
    except csv.Error as error:
        raise InputError(
            f"{path} is not a CSV table ({error}): write a line of {','.join((*words, *numeric))}"
            " for each entry."
        ) from error
    if missing := [name for name in numeric if name not in header]:
        raise InputError(
            f"{path} has no column {missing[0]}: begin it with a line such as"
            f" {','.join((*words, *numeric))}."
        )
    rows: list[tuple[dict[str, str], list[float]]] = []
    for row in table:
        try:
            found = [float(row[name]) for name in numeric]
        except (LookupError, ValueError):
            found = [math.nan]
        if not all(map(math.isfinite, found)):
            raise InputError(
                f"{path}, entry {len(rows) + 1}: {', '.join(numeric)} are not all numbers: correct"
                " that line."
            )
        rows.append(({name: row.get(name, "").strip() for name in words}, found))
    if not rows:
        raise InputError(f"{path} holds no entry: write a line for each below the header.")
    return rows
