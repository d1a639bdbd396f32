"""Recordings of a pair of simulated pinhole cameras before a board that rests in one place after
another.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.planning.pose_bank import camera_matrix
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.schema import Number
from capture.rig.rig_information import RigModel, compose_poses

BOARD = Board(9, 6, 0.025)
BOARD_FLAGS = ("--board", "9x6", "--square-mm", "25")
SIZE = (640, 480)
INTRINSICS = Intrinsics(
    Number(560.0, 0.0), Number(560.0, 0.0), Number(319.5, 0.0), Number(239.5, 0.0)
)
CAMERA = Camera(*SIZE, intrinsics=INTRINSICS)
MODEL = RigModel(
    BOARD,
    {"left": CAMERA, "right": CAMERA},
    {"left": np.zeros(6), "right": np.array([0.0, 0.02, 0.0, -0.06, 0.0, 0.0])},
)
SHARED = tuple(
    np.array(pose)
    for pose in (
        (0.2, 0.3, 0.0, 0.02, 0.0, 0.5),
        (-0.3, 0.1, 0.0, 0.05, 0.02, 0.7),
        (0.1, -0.4, 0.0, -0.01, -0.03, 0.6),
        (0.4, 0.2, 0.1, 0.06, 0.01, 0.9),
    )
)
"""(6,) placements T_left_board that both cameras see."""
ONLY_LEFT = np.array((0.0, 0.2, 0.0, -0.15, 0.0, 0.5))
"""A placement of which the right camera sees a part."""
REST_S = 0.5
"""s for which the board rests in each place."""

Picture = NDArray[np.uint8]
SQUARE = 40
"""px: the side of a square in the drawing."""


def draw_board(camera: str, placement: NDArray[np.float64]) -> Picture:
    """Return the (480, 640) picture that a camera takes of the board at a (6,) placement."""
    squares = np.indices((BOARD.rows + 1, BOARD.columns + 1)).sum(0) % 2
    drawing = np.kron(squares, np.ones((SQUARE, SQUARE))) * 200 + 30
    sheet = np.pad(drawing, SQUARE, constant_values=230.0).astype(np.uint8)
    grid = np.meshgrid(np.arange(BOARD.columns), np.arange(BOARD.rows))
    drawn = 2 * SQUARE - 0.5 + SQUARE * np.stack(grid, -1).reshape(-1, 2)
    pose = compose_poses(MODEL.mountings[camera], placement)
    points = np.column_stack([BOARD.points(), np.zeros(BOARD.count)])
    pixels = cv2.projectPoints(points, pose[:3], pose[3:], camera_matrix(CAMERA), None)[0]
    homography = cv2.findHomography(drawn, pixels.reshape(-1, 2))[0]
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    size = 2 * SIZE[0], 2 * SIZE[1]
    picture = cv2.warpPerspective(sheet, double @ homography, size, borderValue=120)
    return np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def record(
    folder: Path,
    camera: str,
    times_s: Sequence[float],
    placement_at: Callable[[float], NDArray[np.float64] | None],
) -> Path:
    """Write the recording of one camera: a picture at each time, with its time in frames.csv.

    Args:
        placement_at: gives the board's placement at a time; None for a picture without it.
    """
    (folder / "frames").mkdir(parents=True)
    rows = ["file,time_s,sequence,exposure_us"]
    pictures: dict[bytes, Picture] = {}
    for index, time_s in enumerate(times_s):
        placement = placement_at(time_s)
        key = b"" if placement is None else placement.tobytes()
        if key not in pictures:
            blank = np.full(SIZE[::-1], 120, np.uint8)
            pictures[key] = blank if placement is None else draw_board(camera, placement)
        cv2.imwrite(str(folder / "frames" / f"{index:04d}.png"), pictures[key])
        rows.append(f"{index:04d}.png,{1000 + time_s:.6f},{index},8000")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


def resting(
    placements: Sequence[NDArray[np.float64]],
) -> Callable[[float], NDArray[np.float64] | None]:
    """Return the placement at a time of a board that rests in one place after another."""
    return lambda time_s: placements[min(int(time_s / REST_S), len(placements) - 1)]
