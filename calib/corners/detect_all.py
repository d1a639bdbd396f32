"""The pictures of a session -> their corners, by several threads; what was found is kept beside the
pictures.
"""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners import detect as detector
from calib.corners.detect import eight_bits, has_grid, largest_grid
from calib.corners.detection import Detection, NotFound
from calib.corners.find import ADVICE, find_board
from calib.corners.other_coding import other_coding
from calib.corners.view import Rejected, View
from calib.corners.weights import weighted
from calib.errors import InputError, NotEnoughDataError, OtherBoardError
from calib.io.files import read_file, write_atomically
from calib.io.images import read_grey
from calib.session.board import Board
from calib.session.board_section import board_to_yaml

KEPT = ".detections.json"
BEGINNING = b'{"settings": '
"""Of that file, however little of it a full disk has; another one of its name is not replaced."""
FEWEST = 3
"""Views, of however many: with fewer, no calibration is possible."""
SMALLEST_PART = 0.2
"""Of the views: below it, the board is not the declared one, or something is wrong with the
pictures.
"""
PROBED = 6
"""Views, spread over the session, that are looked at first, and once more for other boards if the
declared one is in none of them.
"""
COMMON = (
    (11, 8),
    (10, 7),
    (9, 9),
    (9, 7),
    (9, 6),
    (8, 8),
    (8, 6),
    (8, 5),
    (7, 7),
    (7, 6),
    (7, 5),
    (6, 5),
    (6, 4),
)
"""Boards that people have, the larger first: part of a larger one can pass for a smaller one."""


@dataclass(frozen=True, slots=True)
class Detections:
    """What was seen in the pictures of one folder; every picture is in one of the two."""

    views: tuple[View, ...]
    """In the order of the pictures, each with the corners of the board that could be measured."""
    rejected: tuple[Rejected, ...]


def detect(
    paths: Sequence[Path],
    board: Board,
    progress: Callable[[int, int], None] | None = None,
    *,
    size: tuple[int, int] | None = None,
    fewest: int = FEWEST,
) -> Detections:
    """Look for the board in every picture.

    Args:
        paths: the pictures. Their folders get a `.detections.json`, if they can be written, and it
            is used again.
        progress: called after each view with how many are done, and in how many of them the board
            was found.
        size: width and height that every picture must have, px. None: any.
        fewest: pictures that must show the board, if there are so many.

    Raises:
        InputError: a picture cannot be read, or has another size.
        NotEnoughDataError: the board is in hardly any picture.
        OtherBoardError: but another one is, which the message names.
    """
    if not paths:
        raise NotEnoughDataError(
            f"there is no picture to find the {board} board in: take some, from different sides and"
            " distances."
        )
    sample = sorted({round(index) for index in np.linspace(0, len(paths) - 1, PROBED)})
    rest = [index for index in range(len(paths)) if index not in sample]
    stores = {folder: _Store(folder, board, size) for folder in {path.parent for path in paths}}
    found: dict[int, Detection | NotFound] = {}
    hits = 0
    try:
        for batch in (sample, rest):
            for index, result in zip(
                batch, _in_threads([paths[i] for i in batch], stores), strict=True
            ):
                found[index] = result
                hits += isinstance(result, Detection)
                if progress is not None:
                    progress(len(found), hits)
            if batch is sample and not hits:
                _refuse_other_board([paths[i] for i in sample], board)
    finally:
        for store in stores.values():
            store.save()
    if hits < min(fewest, len(paths)) or hits < SMALLEST_PART * len(paths):
        if hits:
            _refuse_other_board(
                [paths[i] for i in (*sample, *rest) if isinstance(found[i], NotFound)][:PROBED],
                board,
            )
        reasons = Counter(hit.reason for hit in found.values() if isinstance(hit, NotFound))
        advice = reasons.most_common(1)[0][0] if board.coding else ADVICE
        raise NotEnoughDataError(
            f"the {board} board was found in {hits} of {len(paths)} pictures: {advice}, or take"
            " more of them."
        )
    every = [(path.name, found[index]) for index, path in enumerate(paths)]
    views = weighted([_view(name, hit) for name, hit in every if isinstance(hit, Detection)])
    return Detections(
        views, tuple(Rejected(name, hit.reason) for name, hit in every if isinstance(hit, NotFound))
    )


def _view(name: str, hit: Detection) -> View:
    return View(
        name,
        hit.corners,
        np.isfinite(hit.corners[:, 0]).astype(np.float64),
        covariance=hit.covariances,
    )


def _in_threads(
    paths: Sequence[Path], stores: dict[Path, "_Store"]
) -> Iterator[Detection | NotFound]:
    """In the order of the paths.

    OpenCV lets other threads run while it works, and processes would each import it anew.
    """
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield from pool.map(lambda path: stores[path.parent].look(path), paths)
    finally:
        pool.shutdown(cancel_futures=True)


def _refuse_other_board(paths: Sequence[Path], board: Board) -> None:
    """Raise OtherBoardError if at least half of the pictures show one board, and not the declared
    one.
    """
    pictures = [eight_bits(read_grey(path)) for path in paths]
    if board.coding:
        if said := other_coding(pictures, board):
            raise OtherBoardError(said)
        return
    size, count = _shown(pictures, board.square)
    if (
        2 * count >= len(paths)
        and count >= min(2, len(paths))
        and set(size) != {board.columns, board.rows}
    ):
        raise OtherBoardError(
            f"a board of {size[0]}x{size[1]} inner corners fits {count} of the {len(paths)}"
            f" pictures that were tried, the declared {board} none of them: write board.columns:"
            f" {size[0]}, board.rows: {size[1]} in session.yaml."
        )


def _shown(pictures: Sequence[NDArray[np.uint8]], square: float) -> tuple[tuple[int, int], int]:
    """Columns and rows of the board that most pictures show, and how many do; of the common boards
    where none can be measured.
    """
    measured = Counter(grid.size for grid in map(largest_grid, pictures) if grid is not None)
    if measured and 2 * max(measured.values()) >= len(pictures):
        return measured.most_common(1)[0]
    tried = {
        size: sum(has_grid(picture, Board(*size, square)) for picture in pictures)
        for size in COMMON
    }
    return max(tried.items(), key=lambda entry: entry[1])


class _Store:
    """The detections of one folder's pictures, kept from run to run.

    They hold for the same bytes, board, detector and OpenCV alone.
    """

    def __init__(self, folder: Path, board: Board, size: tuple[int, int] | None) -> None:
        self._path, self._board, self._size = folder / KEPT, board, size
        opencv = int(cv2.__version__.split(".")[0])
        self._settings: dict[str, object] = {
            "columns": board.columns,
            "rows": board.rows,
            "detector": detector.VERSION,
            "opencv": opencv,
        }
        if board.coding:
            self._settings["board"] = board_to_yaml(board)
        self._files: dict[str, Any] = {}
        self._changed = False
        self._is_ours = not os.path.lexists(self._path)
        with suppress(InputError, ValueError, KeyError, TypeError, RecursionError):
            data = read_file(self._path)
            self._is_ours = not self._path.is_symlink() and BEGINNING.startswith(
                data[: len(BEGINNING)]
            )
            kept = json.loads(data)
            if kept["settings"] == self._settings and isinstance(kept["files"], dict):
                self._files = kept["files"]

    def look(self, path: Path) -> Detection | NotFound:
        """The kept result, or a new one, for which the picture is decoded. Safe in several threads.

        Raises:
            InputError: it cannot be read, or has another size than is asked for.
        """
        try:
            digest = hashlib.sha256(read_file(path)).hexdigest()
        except InputError:
            digest = ""  # reading the picture says what is wrong
        with suppress(ValueError, KeyError, TypeError, OverflowError):
            found, size = _recalled(self._files[path.name], digest, self._board)
            self._check(path, size)
            return found
        grey = read_grey(path)
        height, width = grey.shape
        self._check(path, (width, height))
        found = find_board(grey, self._board)
        self._files[path.name] = {"sha256": digest, "size": [width, height], **_kept(found)}
        self._changed = True
        return found

    def _check(self, path: Path, size: tuple[int, int]) -> None:
        if self._size and size != self._size:
            raise InputError(
                f"{path} is {size[0]}x{size[1]} px where camera.width and camera.height in"
                f" session.yaml say {self._size[0]}x{self._size[1]}: correct them, or remove the"
                " picture."
            )

    def save(self) -> None:
        if self._changed and self._is_ours:
            with suppress(InputError):  # a folder that cannot be written does without
                write_atomically(
                    self._path,
                    json.dumps(
                        {"settings": self._settings, "files": dict(sorted(self._files.items()))}
                    ),
                )


def _kept(found: Detection | NotFound) -> dict[str, Any]:
    """What an entry says of a detection: x and y of every corner, and the variances of x, of both,
    and of y; null where not measured.
    """
    if isinstance(found, NotFound):
        return {"corners": None, "covariances": None, "detector": None, "reason": found.reason}
    seen = np.isfinite(found.corners[:, 0])
    rows = {"corners": found.corners, "covariances": found.covariances.reshape(-1, 4)[:, [0, 1, 3]]}
    lists = {
        key: [row.tolist() if one else None for row, one in zip(part, seen, strict=True)]
        for key, part in rows.items()
    }
    return {**lists, "detector": found.detector}


def _recalled(
    entry: Any, digest: str, board: Board
) -> tuple[Detection | NotFound, tuple[int, int]]:
    """An entry's result and the picture's width and height.

    Raises:
        ValueError, KeyError, TypeError, OverflowError: it is another picture's, or damaged.
    """
    if entry["sha256"] != digest:
        raise ValueError("another picture")
    width, height = entry["size"]
    if not (type(width) is type(height) is int and isinstance(entry["corners"], list | None)):
        raise ValueError("not a detection")
    if entry["corners"] is None:
        return NotFound(str(entry["reason"])), (width, height)
    seen = np.array([row is not None for row in entry["corners"]])
    corners, variances = (
        _rows(entry[key], seen, width) for key, width in (("corners", 2), ("covariances", 3))
    )
    if len(seen) != board.count or entry["detector"] not in (
        "saddles",
        "sb",
        "classic",
        "part",
        "coded",
    ):
        raise ValueError("not a detection")
    return Detection(corners, variances[:, [0, 1, 1, 2]].reshape(-1, 2, 2), entry["detector"]), (
        width,
        height,
    )


def _rows(
    rows: list[list[float] | None], seen: NDArray[np.bool_], width: int
) -> NDArray[np.float64]:
    """(count, width), NaN where not seen.

    Raises:
        ValueError, TypeError, OverflowError: there is something else in them.
    """
    if not all(type(value) in (int, float) for row in rows if row is not None for value in row):
        raise ValueError("not a number")  # numpy would take texts, and true
    table = np.full((len(seen), width), np.nan)
    table[seen] = np.array([row for row in rows if row is not None], np.float64).reshape(-1, width)
    if not np.isfinite(table[seen]).all():
        raise ValueError("not a number")
    return table
