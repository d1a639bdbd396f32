"""The input of every peer: corners to calibrate with and two sets to be tested on.

The module loads no torch, so it costs a peer no memory.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board

BOARD = Board(9, 9, 0.020)
CORNERS = np.column_stack([BOARD.points(), np.zeros(BOARD.count)])
"""(81, 3) m in board coordinates."""


@dataclass(frozen=True, slots=True)
class Shots:
    """Boards seen by one camera."""

    pixels: NDArray[np.float64]
    """(V, 81, 2) px, NaN where a corner is not in the picture."""
    poses: NDArray[np.float64]
    """(V, 6) the true T_camera_board, rad and m. Only a start for poses that are refitted."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(V, 81) whether a corner is in the picture."""
        return np.asarray(np.isfinite(self.pixels).all(-1))


@dataclass(frozen=True, slots=True)
class Case:
    """One scene."""

    thickness: float
    """m, of the glass."""
    size: tuple[int, int]
    """px, width and height of the pictures."""
    focal: float
    """px"""
    train: Shots
    test: Shots
    """Other views at the same depths."""
    near: Shots
    """Boards nearer than any that was trained on, most of them partly outside the picture."""

    def save(self, file: Path) -> None:
        sets = {"train": self.train, "test": self.test, "near": self.near}
        arrays = {
            f"{name}_{array}": getattr(shots, array)
            for name, shots in sets.items()
            for array in ("pixels", "poses")
        }
        np.savez(file, thickness=self.thickness, size=self.size, focal=self.focal, **arrays)

    @staticmethod
    def load(file: Path) -> "Case":
        with np.load(file) as at:
            sets = [
                Shots(at[f"{name}_pixels"], at[f"{name}_poses"])
                for name in ("train", "test", "near")
            ]
            return Case(
                float(at["thickness"]), tuple(at["size"].tolist()), float(at["focal"]), *sets
            )
