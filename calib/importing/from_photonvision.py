"""Import PhotonVision's calibration file of one resolution, with the corners that it was fitted
from.

Each of `observations` has locationInObjectSpace, points of the board in m, and
locationInImageSpace, their pixels. Of a board with markers these may be a part of the board. Newer
files also have cornersUsed, false for outliers, which is of all corners of the board or of those
that are listed.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief
from calib.importing.session_draft import SessionDraft
from calib.io.files import read_file
from calib.session.board import Board
from calib.session.camera import Camera

Array = NDArray[np.float64]

MAX_BYTES = 256 << 20
OFF_GRID = 0.1
"""The largest distance of a point from the board's grid, in squares. PhotonVision writes the grid
itself.
"""


def from_photonvision(path: Path) -> SessionDraft:
    """Import the corners of a calibration file.

    Raises:
        InputError: the file is not such a file, or holds no corners.
    """
    try:
        document = json.loads(read_file(path, MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise _not_ours(path) from error
    if not isinstance(document, Mapping) or not {"resolution", "cameraIntrinsics"} <= set(document):
        raise _not_ours(path)
    try:
        return _draft(path, document)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{path} is damaged ({brief(error)}): export the calibration from PhotonVision again."
        ) from error


def _not_ours(path: Path) -> InputError:
    return InputError(
        f"{path} is not a calibration of PhotonVision: give the JSON file that its page of cameras"
        " exports."
    )


def _draft(path: Path, document: Mapping[str, object]) -> SessionDraft:
    resolution = _mapping(document["resolution"])
    width, height = int(resolution["width"]), int(resolution["height"])
    observations = _list(document.get("observations") or [])
    square = float(str(document.get("calobjectSpacing", 0)))
    points = [_points(entry["locationInObjectSpace"], "xyz") for entry in observations]
    if not points or not any(map(len, points)) or not square > 0:
        raise NotEnoughDataError(
            f"{path} holds no corners: export the calibration from PhotonVision, or calibrate there"
            " again; other programs' files have its lens alone."
        )
    corner = np.concatenate(points)[:, :2].min(0)
    cells = [np.rint((rows[:, :2] - corner) / square).astype(np.int64) for rows in points]
    for rows, cell in zip(points, cells, strict=True):
        if np.abs((rows[:, :2] - corner) / square - cell).max(initial=0.0) > OFF_GRID:
            raise ValueError("its points are no grid of squares")
    columns, lines = (np.concatenate(cells).max(0) + 1).tolist()
    board = Board(columns, lines, square)
    views = []
    for number, (entry, cell) in enumerate(zip(observations, cells, strict=True)):
        pixels = _points(entry["locationInImageSpace"], "xy")
        views.append(_view(_name(entry, number), board, cell, pixels, entry.get("cornersUsed")))
    seen = tuple(view for view in views if view.seen.any())
    return SessionDraft(path, board, Camera(width, height), views=seen, remarks=_remarks(document))


def _points(listed: object, axes: str) -> Array:
    """Return (N, len(axes)) numbers."""
    rows = [[float(point[axis]) for axis in axes] for point in _list(listed)]
    return np.array(rows, dtype=np.float64).reshape(-1, len(axes))


def _view(name: str, board: Board, cell: NDArray[np.int64], pixels: Array, used: object) -> View:
    if len(cell) != len(pixels):
        raise ValueError(f"{len(pixels)} pixels for {len(cell)} points")
    index = cell[:, 1] * board.columns + cell[:, 0]
    counted = np.isfinite(pixels).all(1) & (pixels >= 0).all(1)
    if isinstance(used, list) and len(used) == board.count:
        counted &= np.array(used, dtype=np.bool_)[index]
    elif isinstance(used, list) and len(used) == len(pixels):
        counted &= np.array(used, dtype=np.bool_)
    corners = np.full((board.count, 2), np.nan)
    weight = np.zeros(board.count)
    corners[index[counted]] = pixels[counted]
    weight[index[counted]] = 1.0
    return View(name, corners, weight)


def _name(entry: Mapping[str, object], number: int) -> str:
    """Return the snapshot's name with its number, so that no two are the same."""
    name = "_".join(Path(str(entry.get("snapshotName") or "")).name.split()).lstrip("#")
    return f"{number:04d}_{name}" if name else f"{number:04d}"


def _remarks(document: Mapping[str, object]) -> tuple[str, ...]:
    """Return a line for session.yaml with PhotonVision's own lens."""
    intrinsics = _mapping(document["cameraIntrinsics"])
    lens = document.get("distCoeffs")
    fx, _, cx, _, fy, cy = map(float, intrinsics["data"][:6])
    distortion = [*map(float, lens["data"])] if isinstance(lens, Mapping) else []
    if not all(map(math.isfinite, (fx, fy, cx, cy, *distortion))):
        return ()
    numbers = f"{{fx: {fx!r}, fy: {fy!r}, cx: {cx!r}, cy: {cy!r}, distortion: {distortion}}}"
    return (f"PhotonVision's own lens, for camera.intrinsics: {numbers}",)


def _mapping(value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{brief(repr(value))} is no mapping")
    return value


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"{brief(repr(value))} is no list")
    return value
