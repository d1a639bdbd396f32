"""Boards with markers, from sheet and session alike, and views of them."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco
from calib.sheet import aprilgrid, charuco
from fixtures.coded_pictures import Drawn, Lens, Print, draw

LENS = Lens(width=480, height=360, focal=480.0, distortion=(-0.1, 0.02, 0.0, 0.0, 0.0))
WHOLE = np.array([0.3, -0.4, 0.2, 0.0, 0.0, 0.33])
PARTIAL = np.array([-0.3, 0.4, 2.1, 0.06, -0.05, 0.2])
"""A pose (m, rad) in which a board of 20 cm reaches out of the picture on two sides."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A board as it is declared, and as it is printed."""

    board: Board
    print: Print

    @staticmethod
    def charuco(printed: charuco.Charuco, square: float = 0.02) -> "Kind":
        coding = Charuco(printed.marker * square, printed.dictionary, printed.legacy_pattern)
        return Kind(Board(printed.columns, printed.rows, square, coding=coding), Print.of(printed, square))

    @staticmethod
    def aprilgrid(printed: aprilgrid.AprilGrid, tag: float = 0.024) -> "Kind":
        coding = AprilGrid(printed.spacing)
        return Kind(Board(2 * printed.columns, 2 * printed.rows, tag, coding=coding), Print.of(printed, tag))

    def view(self, pose: NDArray, seed: int = 1, blur: float = 0.7, lens: Lens = LENS) -> Drawn:
        return draw(self.print, lens, pose, np.random.default_rng(seed), blur=blur)

    def with_coding(self, **changes: Any) -> Board:
        assert self.board.coding
        return replace(self.board, coding=replace(self.board.coding, **changes))


CHARUCO = Kind.charuco(charuco.Charuco(9, 6))
LEGACY = Kind.charuco(charuco.Charuco(6, 7, marker=0.7, dictionary="DICT_5X5_100", legacy_pattern=True), 0.025)
GRID = Kind.aprilgrid(aprilgrid.AprilGrid(6, 6))
WIDE = Kind.aprilgrid(aprilgrid.AprilGrid(5, 4, spacing=0.2), 0.03)
KINDS = {"charuco": CHARUCO, "legacy": LEGACY, "aprilgrid": GRID, "spacing 0.2": WIDE}


def poses(count: int, seed: int, size: float) -> list[NDArray]:
    """In the picture of LENS, tilted by up to 40 degrees about each axis, turned at will, many of them partly outside; `size` in m."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        roll = cv2.Rodrigues(np.array([0, 0, rng.uniform(-3, 3)]))[0]
        turn = cv2.Rodrigues(cv2.Rodrigues(rng.uniform(-0.7, 0.7, 3))[0] @ roll)[0].ravel()
        away = size * rng.uniform(1.0, 1.8)
        found.append(np.array([*turn, *rng.uniform(-0.3, 0.3, 2) * away * [1, 0.75], away]))
    return found
