"""The guide of boards against the fixed order of a screen: `python -m benchmarks.screen_guide`.

Each simulated session has its own uneven cone, and cover and intrinsics are declared with the
errors of `fixtures.rigs.DECLARED`. A laptop's screen is seen in six poses: those of the fixed order
that `capture --screen` asks for, as in fixtures/screen-clean; or the first of them and five that
the informed guide of the boards asks for, held exactly so. For the guide, a grid on the screen
stands in for a board with markers, whose corners are as exact as the points of a screen together.
The error is that of the maps against the true rays, root mean square over the whole picture.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fitting.setup import Setup
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.planning.information import estimate
from calib.planning.pose_bank import MAX_FILL, Reach, make_pose_bank
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.coding import Charuco
from calib.session.session import read_session
from capture.coverage import COVERAGE_CELLS, InformedGuide, KeptView
from capture.guidance import RELIEF_GRID
from fixtures.map_errors import errors
from fixtures.point_sessions import POINT_NOISE, SCREEN_WIDTH, screen_scene, write_point_session
from fixtures.rays import FIXTURES
from fixtures.rigs import declare_numbers
from fixtures.synthetic import HEIGHT, WIDTH, Scene

POSES = 6
SQUARE = SCREEN_WIDTH / 12
GRID = Board(13, 8, SQUARE, coding=Charuco(0.7 * SQUARE, "DICT_4X4_250"))
"""The grid on the screen, for the guide."""
GRID_SIGMA = POINT_NOISE * (GRID.count / 600) ** 0.5
"""px per axis: 600 points of a screen are as exact as the grid."""
REACH = (0.6, 2.0)
"""The nearest and the farthest screen over the distance at which it fills the picture."""
FINE = Board(80, 50, SCREEN_WIDTH / 80)
"""The points of the screen."""
Floats = NDArray[np.float64]


def fixed_poses() -> list[Floats]:
    """Return the (6,) poses of the fixed order."""
    with np.load(FIXTURES / "screen-clean" / "truth.npz") as file:
        turns = Rotation.from_matrix(file["rotations"]).as_rotvec()
        poses = np.concatenate([turns, file["translations"]], axis=1)
    return list(poses[:POSES])


def see(made: Scene, board: Board, pose: Floats, number: int) -> View:
    """Return the points of a board on the screen at a (6,) pose, as the camera sees them."""
    places = torch.from_numpy(board.points())
    placed = made.path.place(places, made.values, torch.from_numpy(pose), MIDDLE)
    pixels = project(made.path, made.values, placed, MIDDLE).numpy()
    seen = np.asarray(((pixels >= 0) & (pixels <= [WIDTH - 1, HEIGHT - 1])).all(-1))
    pixels[~seen] = np.nan
    return View(f"{number:04d}.png", pixels, np.where(seen, 1.0, 0.0))


def guided_poses(made: Scene, setup: Setup) -> list[Floats]:
    """Return the (6,) poses of the informed guide, after the first of the fixed order."""
    poses = fixed_poses()[:1]
    full = Reach.of(GRID, setup.camera).near * MAX_FILL
    reach = Reach(REACH[0] * full, REACH[1] * full)
    bank = make_pose_bank(GRID, setup.camera, reach).poses
    while len(poses) < POSES:
        views = [see(made, GRID, pose, number) for number, pose in enumerate(poses)]
        fitted = replace(estimate(setup, views, RELIEF_GRID), sigma=GRID_SIGMA)
        design = fitted.design(setup, bank, COVERAGE_CELLS, reach.levels())
        guide = InformedGuide(GRID, setup.camera, reach, design)
        hint = guide.next_pose([KeptView(view.corners) for view in views])
        assert hint
        poses.append(hint.pose)
    return poses


def map_error(made: Scene, poses: list[Floats], seed: int) -> float:
    """Return the error in px of the maps that are fitted to these poses."""
    declared = declare_numbers(np.random.default_rng(seed), made.cover)
    views = tuple(see(made, FINE, pose, number) for number, pose in enumerate(poses))
    pictured = replace(made, board=FINE, views=views, poses=torch.from_numpy(np.array(poses)))
    with tempfile.TemporaryDirectory() as temporary:
        session = Path(temporary) / "session"
        folder = write_point_session(session, pictured, seed=seed, declared=declared)
        calibration = fit(read_session(folder), Settings(), Silent())
    squares = [np.mean(error**2) for error, _ in errors(pictured, calibration)]
    return float(np.sqrt(np.mean(squares)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", nargs="?", type=int, default=4, help="simulated sessions")
    options = parser.parse_args()
    table = Table("glass", "fixed order", "guided", title="Errors of the maps, px", box=None)
    for seed in range(options.sessions):
        made = screen_scene(seed, 1, 16, 10)
        intrinsics, cover = declare_numbers(np.random.default_rng(seed), made.cover)
        camera = Camera(WIDTH, HEIGHT, intrinsics=intrinsics)
        setup = Setup(GRID, camera, intrinsics, cover)
        fixed = map_error(made, fixed_poses(), seed)
        guided = map_error(made, guided_poses(made, setup), seed)
        table.add_row(str(seed), f"{fixed:.4f}", f"{guided:.4f}")
    Console(width=80).print(table)


if __name__ == "__main__":
    main()
