"""Find the corners in the pictures of a session, by several threads, and store the detections
beside the pictures.
"""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners import detect as detector
from calib.corners.detect import eight_bits
from calib.corners.detection import Detection, NotFound
from calib.corners.find import CHECKERBOARD_ADVICE, describe_two_boards, find_board
from calib.corners.other_board import SAMPLE_SIZE, describe_larger_board, describe_other_board
from calib.corners.view import RejectedPicture, View
from calib.corners.weights import weigh_views
from calib.errors import InputError, NotEnoughDataError, OtherBoardError
from calib.io.files import read_file, write_atomically
from calib.io.images import DamagedPictureError, picture_bytes, read_grey
from calib.io.numerals import counted
from calib.session.board import Board
from calib.session.board_section import board_to_yaml

DETECTIONS_FILE = ".detections.json"
FILE_START = b'{"settings": '
"""The first bytes of that file, however little of it a full disk holds. A file of another kind is
not replaced.
"""
MIN_VIEWS = 3
"""Views that a calibration needs, however many pictures there are."""
MIN_FRACTION = 0.2
"""Part of the pictures that must show the board. Below it, the board is not the declared one, or
something is wrong with the pictures.
"""


class OtherSize(NotFound):
    """The picture has another size than the camera's pictures."""


class Damaged(NotFound):
    """The file holds no whole picture of a type that is read."""


@dataclass(frozen=True, slots=True)
class Detections:
    """The detections of a session's pictures: every picture is a view or rejected."""

    views: tuple[View, ...]
    """In the order of the pictures, each with the corners of the board that could be measured."""
    rejected: tuple[RejectedPicture, ...]


def detect(
    paths: Sequence[Path],
    board: Board,
    progress: Callable[[int, int], None] | None = None,
    *,
    size: tuple[int, int] | None = None,
    min_views: int = MIN_VIEWS,
) -> Detections:
    """Look for the board in every picture.

    Args:
        paths: the pictures. Each of their folders gets a `.detections.json` if it is writable, and
            its contents are used again.
        board: the board.
        progress: called after each picture with the number of finished pictures, and the number of
            those that show the board.
        size: width and height of the camera's pictures, px. Those of another size are rejected.
            None: any.
        min_views: pictures that must show the board, if there are so many.

    Raises:
        DamagedPictureError: at least half of the pictures are damaged.
        InputError: the target is one of points, or at least half of the pictures have another
            size.
        NotEnoughDataError: hardly any picture shows the board.
        OtherBoardError: the pictures show another board, which the message names.
    """
    if not board.has_grid:
        raise InputError(
            "A target of points is not found in pictures: give a session whose folder points/ has"
            " its points."
        )
    if not paths:
        raise NotEnoughDataError(
            f"there is no picture to find the {board} board in: take some, from different sides and"
            " distances."
        )
    sample = sorted({round(index) for index in np.linspace(0, len(paths) - 1, SAMPLE_SIZE)})
    remainder = [index for index in range(len(paths)) if index not in sample]
    stores = {folder: _Store(folder, board, size) for folder in {path.parent for path in paths}}
    search = _Search(paths, board, min_views)
    try:
        for batch in (sample, remainder):
            results = _in_threads([paths[i] for i in batch], stores)
            for index, result in zip(batch, results, strict=True):
                search.add(index, result)
                if progress is not None:
                    progress(len(search.results), search.hits)
            search.refuse_damaged()
            search.refuse_other_size()
            if batch is sample and not search.hits:
                search.refuse_other_board(sample)
    finally:
        for store in stores.values():
            store.save()
    search.refuse_few((*sample, *remainder))
    return search.detections()


@dataclass(slots=True)
class _Search:
    """The results of the pictures that were searched so far, by the index of each picture."""

    paths: Sequence[Path]
    board: Board
    min_views: int
    results: dict[int, Detection | NotFound] = field(default_factory=dict)
    hits: int = 0
    """The number of pictures that show the board."""

    def add(self, index: int, result: Detection | NotFound) -> None:
        """Add the result of a picture."""
        self.results[index] = result
        self.hits += isinstance(result, Detection)

    @property
    def _damaged(self) -> list[int]:
        return [i for i, result in self.results.items() if isinstance(result, Damaged)]

    @property
    def _other_sizes(self) -> dict[int, str]:
        """The reason of each picture of another size."""
        return {i: r.reason for i, r in self.results.items() if isinstance(r, OtherSize)}

    @property
    def _usable(self) -> int:
        """The number of all pictures but those that are damaged or of another size."""
        return len(self.paths) - len(self._other_sizes) - len(self._damaged)

    def refuse_damaged(self) -> None:
        """Raise DamagedPictureError if half of the pictures, or all so far, are damaged."""
        damaged = self._damaged
        if 2 * len(damaged) >= len(self.paths) or len(damaged) == len(self.results):
            read_grey(self.paths[min(damaged)])  # raises with the reason

    def refuse_other_size(self) -> None:
        """Raise InputError if too few pictures have the camera's size."""
        other_sizes = self._other_sizes
        usable = self._usable
        too_few = usable < min(self.min_views, len(self.paths) - len(self._damaged))
        if other_sizes and (too_few or len(other_sizes) >= min(usable, len(self.results))):
            first = min(other_sizes)
            raise InputError(
                f"{self.paths[first]} is {other_sizes[first]}, and too few pictures have that size:"
                " correct camera.width and camera.height in session.yaml, or give the pictures of"
                " this camera mode."
            )

    def refuse_other_board(self, order: Sequence[int]) -> None:
        """Raise OtherBoardError if the first of these pictures that do not show the declared board
        show another one.
        """
        damaged = self._damaged
        misses = [i for i in order if isinstance(self.results[i], NotFound) and i not in damaged]
        _refuse_other_board([self.paths[i] for i in misses[:SAMPLE_SIZE]], self.board)

    def refuse_few(self, order: Sequence[int]) -> None:
        """Raise an error with the most frequent reason if too few pictures show the board.

        Args:
            order: the order in which the pictures were searched.
        """
        needed = min(self.min_views, len(self.paths))
        if self.hits >= needed and self.hits >= MIN_FRACTION * self._usable:
            return
        if self.hits:
            self.refuse_other_board(order)
        damaged = self._damaged
        if damaged and self.hits + len(damaged) >= needed:
            read_grey(self.paths[min(damaged)])  # raises with the reason
        reasons = Counter(
            result.reason
            for result in self.results.values()
            if isinstance(result, NotFound) and not isinstance(result, Damaged | OtherSize)
        )
        advice = next((reason for reason, _ in reasons.most_common(1)), CHECKERBOARD_ADVICE)
        if not self.board.coding and advice != describe_two_boards(self.board):
            advice = CHECKERBOARD_ADVICE
        raise NotEnoughDataError(
            f"the {self.board} board was found in {self.hits} of"
            f" {counted(len(self.paths), 'picture')}: {advice}, {self._further_advice}."
        )

    @property
    def _further_advice(self) -> str:
        """What else may help: if no picture shows the board, it may be another one."""
        if self.hits:
            return "or take more of them"
        if self.board.coding:
            return "and check that it has the declared type, columns, rows and dictionary"
        return f"and check that it has {self.board} inner corners (board.columns, board.rows)"

    def detections(self) -> Detections:
        """Return the views and the rejected pictures, in the order of the pictures."""
        views: list[View] = []
        rejected: list[RejectedPicture] = []
        for index, path in enumerate(self.paths):
            result = self.results[index]
            if isinstance(result, Detection):
                views.append(_view(path.name, result))
            else:
                rejected.append(RejectedPicture(path.name, result.reason))
        return Detections(weigh_views(views), tuple(rejected))


def _view(name: str, detection: Detection) -> View:
    return View(
        name,
        detection.corners,
        np.isfinite(detection.corners[:, 0]).astype(np.float64),
        covariance=detection.covariances,
        blur=detection.blurs,
    )


def _in_threads(
    paths: Sequence[Path], stores: dict[Path, "_Store"]
) -> Iterator[Detection | NotFound]:
    """Yield the results in the order of the paths.

    OpenCV releases the interpreter's lock while it works; processes would each import it anew.
    """
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield from pool.map(lambda path: stores[path.parent].look(path), paths)
    finally:
        pool.shutdown(cancel_futures=True)


def _refuse_other_board(paths: Sequence[Path], board: Board) -> None:
    """Raise OtherBoardError if the pictures show one board, and it is not the declared one."""
    pictures = [eight_bits(read_grey(path)) for path in paths]
    if sentence := describe_other_board(pictures, board):
        raise OtherBoardError(sentence)


def refuse_larger_board(paths: Sequence[Path], board: Board) -> None:
    """Raise OtherBoardError if the pictures show a larger checkerboard than the declared one, which
    then is another part of it in each picture.
    """
    if board.coding:
        return
    pictures = [eight_bits(read_grey(path)) for path in paths[:SAMPLE_SIZE]]
    if sentence := describe_larger_board(pictures, board):
        raise OtherBoardError(sentence)


class _Store:
    """The detections of one folder's pictures, stored from run to run.

    They are valid only for the same bytes, board, detector and OpenCV.
    """

    def __init__(self, folder: Path, board: Board, size: tuple[int, int] | None) -> None:
        self._path = folder / DETECTIONS_FILE
        self._board = board
        self._size = size
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
            self._is_ours = not self._path.is_symlink() and FILE_START.startswith(
                data[: len(FILE_START)]
            )
            document = json.loads(data)
            if document["settings"] == self._settings and isinstance(document["files"], dict):
                self._files = document["files"]

    def look(self, path: Path) -> Detection | NotFound:
        """Return the stored result, or search the picture. Safe in several threads."""
        try:
            digest = hashlib.sha256(picture_bytes(path)).hexdigest()
        except DamagedPictureError as error:
            return Damaged(error.reason)
        with suppress(ValueError, KeyError, TypeError, OverflowError):
            result, size = _from_entry(self._files[path.name], digest, self._board)
            return self._wrong_size(size) or result
        try:
            grey = read_grey(path)
        except DamagedPictureError as error:
            return Damaged(error.reason)
        height, width = grey.shape
        if wrong := self._wrong_size((width, height)):
            return wrong
        result = find_board(grey, self._board)
        self._files[path.name] = {"sha256": digest, "size": [width, height], **_to_entry(result)}
        self._changed = True
        return result

    def _wrong_size(self, size: tuple[int, int]) -> OtherSize | None:
        """Return why a picture of this size is rejected; None if it has that of the camera."""
        if not self._size or size == self._size:
            return None
        return OtherSize(
            f"{size[0]}x{size[1]} px where the camera's pictures are"
            f" {self._size[0]}x{self._size[1]}"
        )

    def save(self) -> None:
        if self._changed and self._is_ours:
            with suppress(InputError):  # a folder that is not writable gets no file
                write_atomically(
                    self._path,
                    json.dumps(
                        {"settings": self._settings, "files": dict(sorted(self._files.items()))}
                    ),
                )


def _to_entry(result: Detection | NotFound) -> dict[str, Any]:
    """Return the result as JSON: x and y of every corner; the variance of x, the covariance, and
    the variance of y; the blurs across both edges. Null where a corner is not measured.
    """
    if isinstance(result, NotFound):
        return {"corners": None, "covariances": None, "detector": None, "reason": result.reason}
    visible = np.isfinite(result.corners[:, 0])
    return {
        "corners": _to_rows(result.corners, visible),
        "covariances": _to_rows(result.covariances.reshape(-1, 4)[:, [0, 1, 3]], visible),
        "blurs": _to_rows(result.blurs, visible),
        "detector": result.detector,
    }


def _to_rows(table: NDArray[np.float64], visible: NDArray[np.bool_]) -> list[list[float] | None]:
    """Return the rows of a (count, width) table, None where not visible."""
    return [row.tolist() if shown else None for row, shown in zip(table, visible, strict=True)]


def _from_entry(
    entry: Any, digest: str, board: Board
) -> tuple[Detection | NotFound, tuple[int, int]]:
    """Return an entry's result and the picture's width and height.

    Raises:
        ValueError, KeyError, TypeError, OverflowError: it is another picture's entry, damaged, or
            of an earlier version that kept no blurs.
    """
    if entry["sha256"] != digest:
        raise ValueError("another picture")
    width, height = entry["size"]
    if not (type(width) is type(height) is int and isinstance(entry["corners"], list | None)):
        raise ValueError("not a detection")
    if entry["corners"] is None:
        return NotFound(str(entry["reason"])), (width, height)
    visible = np.array([row is not None for row in entry["corners"]])
    corners = _from_rows(entry["corners"], visible, 2)
    variances = _from_rows(entry["covariances"], visible, 3)
    blurs = _from_rows(entry["blurs"], visible, 2)
    if (blurs <= 0).any():
        raise ValueError("not a width")
    if len(visible) != board.count or entry["detector"] not in (
        "saddles",
        "sb",
        "classic",
        "part",
        "coded",
    ):
        raise ValueError("not a detection")
    covariances = variances[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return Detection(corners, covariances, blurs, entry["detector"]), (width, height)


def _from_rows(
    rows: list[list[float] | None], visible: NDArray[np.bool_], width: int
) -> NDArray[np.float64]:
    """Return a (count, width) table, NaN where not visible.

    Raises:
        ValueError, TypeError, OverflowError: the rows contain something else than numbers.
    """
    if not all(type(value) in (int, float) for row in rows if row is not None for value in row):
        raise ValueError("not a number")  # numpy would take texts, and true
    table = np.full((len(visible), width), np.nan)
    table[visible] = np.array([row for row in rows if row is not None], np.float64).reshape(
        -1, width
    )
    if not np.isfinite(table[visible]).all():
        raise ValueError("not a number")
    return table
