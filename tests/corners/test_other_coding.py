"""A session whose board with markers is not the declared one: the sentence says what the pictures
show.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detect_all import DETECTIONS_FILE, detect
from calib.errors import NotEnoughDataError
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco
from fixtures.coded_boards import CHARUCO, GRID, LEGACY, WHOLE, Kind


@cache
def pictures(name: str) -> list[NDArray[np.uint8]]:
    kind = {"charuco": CHARUCO, "legacy": LEGACY, "aprilgrid": GRID}[name]
    return [kind.view(WHOLE + np.array([0, 0, turn, 0, 0, 0.02])).picture for turn in (0, 0.7, 1.5)]


def write(folder: Path, shown: list[NDArray[np.uint8]]) -> list[Path]:
    paths = [folder / f"{number}.png" for number in range(len(shown))]
    for path, picture in zip(paths, shown, strict=True):
        cv2.imwrite(str(path), picture)
    return paths


DECLARED: dict[str, tuple[str, Kind, Callable[[Board], Board], str]] = {
    "dictionary": (
        "charuco",
        CHARUCO,
        lambda _: CHARUCO.with_coding(dictionary="DICT_6X6_250"),
        "markers of DICT_4X4_50 with .* one cell",
    ),
    "legacy": (
        "legacy",
        LEGACY,
        lambda _: LEGACY.with_coding(legacy_pattern=False),
        "write board.legacy_pattern: true",
    ),
    "columns": (
        "charuco",
        CHARUCO,
        lambda board: replace(board, columns=10),
        "with 9 columns, .* write board.columns: 9",
    ),
    "marker": (
        "charuco",
        CHARUCO,
        lambda _: CHARUCO.with_coding(marker=0.01),
        "correct board.marker_mm",
    ),
    "tags": (
        "aprilgrid",
        GRID,
        lambda board: replace(board, columns=10),
        "with 6 columns, .* write board.columns: 6",
    ),
    "spacing": (
        "aprilgrid",
        GRID,
        lambda _: GRID.with_coding(spacing=0.2),
        "0.30 of their side apart, where 0.2 is declared",
    ),
    "charuco for aprilgrid": (
        "aprilgrid",
        GRID,
        lambda _: Board(9, 6, 0.02, coding=Charuco(0.015, "DICT_5X5_100")),
        "markers of DICT_APRILTAG_36h11 with a black border of two cells",
    ),
    "aprilgrid for charuco": (
        "charuco",
        CHARUCO,
        lambda _: Board(12, 12, 0.02, coding=AprilGrid(0.3)),
        "markers of DICT_4X4_50",
    ),
}


CASES = [
    pytest.param(case, id=name, marks=[pytest.mark.slow] * (name == "aprilgrid for charuco"))
    for name, case in DECLARED.items()
]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_target_in_the_pictures_is_named(
    case: tuple[str, Kind, Callable[[Board], Board], str], tmp_path: Path
) -> None:
    name, kind, change, says = case
    with pytest.raises(NotEnoughDataError, match=says):
        detect(write(tmp_path, pictures(name)), change(kind.board))


@pytest.mark.parametrize("name", [pytest.param("charuco", marks=pytest.mark.slow), "aprilgrid"])
def test_mirrored_pictures_are_reported(name: str, tmp_path: Path) -> None:
    flipped = [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures(name)]
    with pytest.raises(
        NotEnoughDataError, match="can be read only in a mirror: turn the pictures' mirroring off"
    ):
        detect(write(tmp_path, flipped), (CHARUCO if name == "charuco" else GRID).board)


def test_pictures_without_any_board(tmp_path: Path) -> None:
    wall = [np.full((120, 160), 120, np.uint8)] * 3
    with pytest.raises(
        NotEnoughDataError,
        match="found in 0 of 3 pictures: no marker of the 9x6 ChArUco board found",
    ):
        detect(write(tmp_path, wall), CHARUCO.board)


def test_a_refused_picture_is_listed_with_its_reason_and_both_are_kept(tmp_path: Path) -> None:
    """The second run reads no picture: what was found, and why not, is in the store; another
    board's is not taken.
    """
    shown = [*pictures("charuco"), np.hstack([pictures("charuco")[0][:, :240]] * 2)]
    paths = write(tmp_path, shown)
    detections = detect(paths, CHARUCO.board)
    assert len(detections.views) == 3
    (rejected,) = detections.rejected
    assert rejected.name == "3.png"
    assert "is seen twice" in rejected.reason
    stored = (tmp_path / DETECTIONS_FILE).read_bytes()
    repeat = detect(paths, CHARUCO.board)
    assert repeat.rejected == detections.rejected
    for view, same in zip(detections.views, repeat.views, strict=True):
        assert np.array_equal(view.corners, same.corners, equal_nan=True)
        assert view.covariance is not None
        assert np.array_equal(view.covariance, np.asarray(same.covariance), equal_nan=True)
    assert (tmp_path / DETECTIONS_FILE).read_bytes() == stored
    with pytest.raises(NotEnoughDataError):
        detect(paths, replace(CHARUCO.board, columns=10))
