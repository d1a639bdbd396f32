"""Cameras over water, calibrated by Refracal and by AquaCal 2.1 from the same corners:
`python -m benchmarks.aquacal [--cameras N] [--frames N] [--rigs N] [--program NAME] [--level]
[--turn-deg SIGMA]`.

The data are those of AquaCal's own generator, scenario `realistic`: cameras 1.031 m above the water
look straight down at a ChArUco board of 12 by 9 squares of 60 mm, 0.2 to 1 m under water, with
0.5 px of noise. The scenario has twelve cameras, of which `--cameras` takes the first ones, and 30
frames. With `--turn-deg`, the cameras do not look straight down.

Both programs are given the same numbers, and estimate the same:

- focal lengths, principal points and the height of the first camera over the water, each off by a
  draw of FOCAL, CENTRE_PX and HEIGHT;
- the true lens distortion, the true indices of air and water and the true size of the board, which
  both hold;
- water that is square to the first camera's axis, which is true. Both estimate its tilt, or hold
  it with `--level`.

Refracal also reads the standard deviation of each declared number, and TILT for the tilt. AquaCal
starts from the same numbers, and takes no standard deviation. So `Refracal-weak` is a second run,
with standard deviations that are WEAK times as large and say little.

For Refracal, the water is a flat window: `outside_index` 1.333, and a sheet of 0.1 mm with the same
`refractive_index`. All cameras share it (`shared_cover`).

- focal: the error of fx and fy, root mean square.
- height: the error of each camera's distance from the water, root mean square.
- lengths: the error of the sides of the squares, 60 mm, of the board in other places, which at
  least two cameras see: root mean square and signed mean, from exact pixels (the calibration's own
  part), and from pixels with 0.5 px of noise.
- CPU: the calibration alone.

Each program triangulates for itself. AquaCal takes the point nearest to the rays, Refracal the one
whose projections are nearest to the pixels. From exact pixels this makes the larger part of the
difference between the two.

AquaCal needs opencv-python 4.13, which must not be installed over the OpenCV of Refracal. So
install it into a folder by itself, and add that folder to PYTHONPATH:
`pip install --no-deps --target FOLDER aquacal natsort pandas six tqdm`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.fit_record.request import EVEN_GRID, Settings
from calib.rig.fit_rig import fit_rig
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.coding import Charuco
from calib.session.cover import Cover
from calib.session.schema import Number
from calib.session.session import session_to_yaml

try:
    from aquacal.calibration.extrinsics import build_pose_graph, estimate_extrinsics
    from aquacal.calibration.interface_estimation import optimize_interface
    from aquacal.calibration.refinement import joint_refinement
    from aquacal.config.schema import (
        BoardPose,
        CalibrationMetadata,
        CalibrationResult,
        CameraCalibration,
        CameraExtrinsics,
        CameraIntrinsics,
        Detection,
        DetectionResult,
        DiagnosticsData,
        InterfaceParams,
    )
    from aquacal.core.board import BoardGeometry
    from aquacal.datasets.synthetic import (
        SyntheticScenario,
        create_scenario,
        generate_real_rig_trajectory,
        generate_synthetic_detections,
    )
    from aquacal.triangulation import triangulate_point
    from aquacal.validation.reconstruction import get_adjacent_corner_pairs
except ImportError as error:
    raise SystemExit(
        f"This benchmark needs AquaCal ({error}): pip install aquacal; the head of"
        " benchmarks/aquacal.py says how."
    ) from None

FOCAL = 0.005
"""The relative standard deviation of each declared focal length."""
CENTRE_PX = 4.0
"""px: the standard deviation of each declared coordinate of a principal point."""
HEIGHT = 0.010
"""m: the standard deviation of the declared height over the water."""
TILT = np.deg2rad(1.0)
"""rad: the standard deviation of the water's tilt about each axis of the first camera."""
WEAK = 10.0
"""The factor on the standard deviations that say little."""
SHEET = 1e-4
"""m: the thickness of the window that stands for the water's surface."""
NORMAL = np.array([0.0, 0.0, -1.0])
"""The water's normal, upwards, in AquaCal's world, whose z axis points down."""
HELD_OUT = 30
"""The placements of the board whose lengths are measured."""
EVEN = Settings(grid=EVEN_GRID, flat_board=True)
"""The options of Refracal's fit: an even surface and a flat board, as AquaCal takes them."""

Array = NDArray[np.float64]
Pixels = Mapping[str, Array]
"""For each camera, (N, 2) px; NaN for a point that it does not see."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """The corners of one rig, the numbers that are declared, and the truth."""

    truth: SyntheticScenario
    board: BoardGeometry
    detections: DetectionResult
    declared: Mapping[str, CameraIntrinsics]
    height: float
    """m: the declared height of the first camera over the water."""
    level: bool
    """True if the water is known to be square to the first camera's axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A calibration by either program."""

    focal: Array
    """(C, 2) px"""
    height: Array
    """(C,) m: each camera's distance from the water."""
    triangulate: Callable[[Pixels], Array]
    """Return the (N, 3) m points of some pixels; NaN where fewer than two cameras see a point."""
    seconds: float
    """s of CPU time."""


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """The errors of one calibration."""

    focal: Array
    """(2 C,) relative."""
    height: Array
    """(C,) m"""
    exact: Array
    """(L,) m: of the lengths from exact pixels."""
    noisy: Array
    """(L,) m: of the lengths from noisy pixels."""
    seconds: float
    """s of CPU time."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=12, help="2 to 12 (default: 12)")
    parser.add_argument("--frames", type=int, default=30, help="places of the board (default: 30)")
    parser.add_argument("--rigs", type=int, default=3, help="data sets (default: 3)")
    level = "both know that the water is square to the first camera's axis"
    parser.add_argument("--level", action="store_true", help=level)
    parser.add_argument("--program", choices=PROGRAMS, action="append", help="only this one")
    turn = "turn each further camera by a draw of this, about each axis (default: 0)"
    parser.add_argument("--turn-deg", type=float, default=0.0, metavar="SIGMA", help=turn)
    options = parser.parse_args()
    console = Console(soft_wrap=True)
    rows: dict[str, list[Errors]] = {}
    turn_rad = float(np.deg2rad(options.turn_deg))
    for seed in range(options.rigs):
        task = make_task(seed, options.cameras, options.frames, turn_rad, options.level)
        for name in (DECLARED, *(options.program or PROGRAMS)):
            solution = PROGRAMS[name](task) if name in PROGRAMS else solve_nothing(task)
            rows.setdefault(name, []).append(measure(task, solution, seed))
    count = f"{options.cameras} cameras, {options.frames} frames, {options.rigs} rigs"
    console.print(_table(count, rows))


def make_task(seed: int, cameras: int, frames: int, turn: float, level: bool) -> Task:
    """Return the first cameras of AquaCal's realistic scenario, the corners that they see, and
    declared numbers that are each off by a draw.

    Args:
        turn: rad, the standard deviation of the turn of each camera but the first about each axis.
        level: True if the water is known to be square to the first camera's axis.
    """
    rng = np.random.default_rng(seed)
    scenario = create_scenario("realistic", seed=seed)
    names = list(scenario.intrinsics)[:cameras]
    mountings = {names[0]: scenario.extrinsics[names[0]]}
    for name in names[1:]:
        rotation, _ = cv2.Rodrigues(rng.normal(0, 1, 3) * turn)
        mountings[name] = CameraExtrinsics(rotation, -rotation @ scenario.extrinsics[name].C)
    truth = replace(
        scenario,
        intrinsics={name: scenario.intrinsics[name] for name in names},
        extrinsics=mountings,
        water_zs={name: scenario.water_zs[name] for name in names},
        board_poses=_trajectory(scenario, frames, seed),
    )
    declared = {}
    for name, lens in truth.intrinsics.items():
        matrix = lens.K.copy()
        matrix[[0, 1], [0, 1]] *= 1 + rng.normal(0, FOCAL, 2)
        matrix[:2, 2] += rng.normal(0, CENTRE_PX, 2)
        declared[name] = replace(lens, K=matrix)
    return Task(
        truth=truth,
        board=BoardGeometry(truth.board_config),
        detections=_detect(truth, truth.board_poses, truth.noise_std, seed),
        declared=declared,
        height=float(truth.water_zs[names[0]] + rng.normal(0, HEIGHT)),
        level=level,
    )


def solve_nothing(task: Task) -> Solution:
    """Return the declared numbers, which measure no lengths."""
    names = list(task.declared)
    return Solution(
        focal=np.array([task.declared[name].K[[0, 1], [0, 1]] for name in names]),
        height=np.full(len(names), task.height),
        triangulate=lambda pixels: np.full((len(pixels[names[0]]), 3), np.nan),
        seconds=0.0,
    )


def solve_by_aquacal(task: Task) -> Solution:
    """Return the calibration by AquaCal: the stages and options of its `calibrate_synthetic`, from
    the declared numbers.
    """
    names = list(task.declared)
    water = dict.fromkeys(names, task.height)
    scene = {"interface_normal": NORMAL, "n_air": task.truth.n_air, "n_water": task.truth.n_water}
    start = time.process_time()
    with redirect_stdout(StringIO()):
        mountings = estimate_extrinsics(
            build_pose_graph(task.detections, min_cameras=2),
            task.declared,
            task.board,
            names[0],
            water_zs=water,
            **scene,
        )
        first_pass = optimize_interface(
            task.detections,
            task.declared,
            mountings,
            task.board,
            names[0],
            initial_water_zs=water,
            normal_fixed=task.level,
            **scene,
        )
        mountings, water, _, lenses, rms = joint_refinement(
            first_pass,
            task.detections,
            task.declared,
            task.board,
            names[0],
            refine_intrinsics=True,
            normal_fixed=task.level,
            **scene,
        )
    seconds = time.process_time() - start
    result = CalibrationResult(
        cameras={
            name: CameraCalibration(name, lenses[name], mountings[name], water[name])
            for name in names
        },
        interface=InterfaceParams(NORMAL, task.truth.n_air, task.truth.n_water),
        board=task.truth.board_config,
        diagnostics=DiagnosticsData(rms, {}, 0.0, 0.0),
        metadata=CalibrationMetadata("", "", "", 0, 0),
    )

    def triangulate(pixels: Pixels) -> Array:
        points = np.full((len(pixels[names[0]]), 3), np.nan)
        for index in range(len(points)):
            views = {name: pixels[name][index] for name in names}
            seen_by = {name: pixel for name, pixel in views.items() if np.isfinite(pixel).all()}
            point = triangulate_point(result, seen_by)
            if point is not None:
                points[index] = point
        return points

    return Solution(
        focal=np.array([lenses[name].K[[0, 1], [0, 1]] for name in names]),
        height=np.array([water[name] - mountings[name].C[2] for name in names]),
        triangulate=triangulate,
        seconds=seconds,
    )


def solve_by_refracal(task: Task, factor: float) -> Solution:
    """Return the calibration by Refracal.

    Args:
        factor: on each declared standard deviation.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = write_rig(task, Path(folder), factor)
        start = time.process_time()
        rig = fit_rig(file, EVEN)
        seconds = time.process_time() - start
    focal = []
    height = []
    for calibration in rig.calibrations.values():
        lens = calibration.camera.intrinsics
        assert lens
        focal.append((lens.fx.value, lens.fy.value))
        water = calibration.cover.parameters
        tilt = np.hypot(water["tilt.x"].value, water["tilt.y"].value)
        height.append(water["distance"].value * np.cos(tilt))
    return Solution(np.array(focal), np.array(height), rig.points, seconds)


def write_rig(task: Task, folder: Path, factor: float) -> Path:
    """Write rig.yaml and a session for each camera, and return the former's path.

    Args:
        factor: on each declared standard deviation.
    """
    names = list(task.declared)
    tilt = Number(0.0, exact=True) if task.level else Number(0.0, factor * TILT)
    numbers = {
        "distance": Number(task.height, factor * HEIGHT),
        "tilt.x": tilt,
        "tilt.y": tilt,
        "thickness": Number(SHEET, exact=True),
        "refractive_index": Number(task.truth.n_water, exact=True),
        "outside_index": Number(task.truth.n_water, exact=True),
    }
    water = Cover("flat", numbers)
    for name, lens in task.declared.items():
        session = folder / name
        session.mkdir()
        (fx, fy), (cx, cy) = lens.K[[0, 1], [0, 1]], lens.K[:2, 2]
        intrinsics = Intrinsics(
            fx=Number(float(fx), float(factor * FOCAL * fx)),
            fy=Number(float(fy), float(factor * FOCAL * fy)),
            cx=Number(float(cx), factor * CENTRE_PX),
            cy=Number(float(cy), factor * CENTRE_PX),
            distortion=tuple(Number(float(value), exact=True) for value in lens.dist_coeffs),
        )
        width, height = lens.image_size
        camera = Camera(width, height, intrinsics=intrinsics)
        content = session_to_yaml(_board(task.truth), camera, water)
        text = yaml.safe_dump({"format": 1, **content, "corners": "corners.vnl"})
        (session / "session.yaml").write_text(text)
        write_corners(session / "corners.vnl", _views(task, name))
    file = folder / "rig.yaml"
    rig = {
        "format": 1,
        "cameras": {name: name for name in names},
        "reference": names[0],
        "together": "by_name",
        "shared_cover": [names],
    }
    file.write_text(yaml.safe_dump(rig))
    return file


def measure(task: Task, solution: Solution, seed: int) -> Errors:
    """Return the errors of a calibration."""
    truth = task.truth
    focal = np.array([lens.K[[0, 1], [0, 1]] for lens in truth.intrinsics.values()])
    height = np.array(
        [truth.water_zs[name] - truth.extrinsics[name].C[2] for name in task.declared]
    )
    return Errors(
        focal=(solution.focal / focal - 1).ravel(),
        height=solution.height - height,
        exact=_length_errors(task, solution, seed, 0.0),
        noisy=_length_errors(task, solution, seed, truth.noise_std),
        seconds=solution.seconds,
    )


DECLARED = "declared"
"""The name of the row of the declared numbers."""
PROGRAMS: Mapping[str, Callable[[Task], Solution]] = {
    "AquaCal": solve_by_aquacal,
    "Refracal": lambda task: solve_by_refracal(task, 1.0),
    "Refracal-weak": lambda task: solve_by_refracal(task, WEAK),
}
"""The programs by the names of their rows."""


def _length_errors(task: Task, solution: Solution, seed: int, noise_px: float) -> Array:
    """Return the (L,) m errors of the sides of squares of a board in other places."""
    poses = _trajectory(task.truth, HELD_OUT, seed + 1000)
    detections = _detect(task.truth, poses, noise_px, seed + 2000)
    frames = list(detections.frames)
    count = task.board.num_corners
    pixels = {name: np.full((len(frames), count, 2), np.nan) for name in task.declared}
    for index, frame in enumerate(frames):
        for name, corners in detections.frames[frame].detections.items():
            pixels[name][index, corners.corner_ids] = corners.corners_2d
    points = solution.triangulate({name: rows.reshape(-1, 2) for name, rows in pixels.items()})
    pairs = np.array(get_adjacent_corner_pairs(task.board))
    ends = points.reshape(len(frames), count, 3)[:, pairs]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1)
    errors = lengths[np.isfinite(lengths)] - task.truth.board_config.square_size
    return np.asarray(errors, np.float64)


def _trajectory(scenario: SyntheticScenario, frames: int, seed: int) -> list[BoardPose]:
    poses: list[BoardPose] = generate_real_rig_trajectory(
        frames, board=scenario.board_config, water_zs=scenario.water_zs, seed=seed
    )
    return poses


def _detect(
    truth: SyntheticScenario, poses: Sequence[BoardPose], noise_px: float, seed: int
) -> DetectionResult:
    """Return the corners of some places of the board, without those that noise, or half a pixel,
    moved out of the picture: Refracal refuses them.
    """
    result: DetectionResult = generate_synthetic_detections(
        truth.intrinsics,
        truth.extrinsics,
        truth.water_zs,
        BoardGeometry(truth.board_config),
        poses,
        noise_std=noise_px,
        n_air=truth.n_air,
        n_water=truth.n_water,
        seed=seed,
    )
    for frame in result.frames.values():
        for name, corners in frame.detections.items():
            last = np.array(truth.intrinsics[name].image_size) - 0.5
            pixels = corners.corners_2d
            inside = ((pixels >= -0.5) & (pixels <= last)).all(-1)
            frame.detections[name] = Detection(corners.corner_ids[inside], pixels[inside])
    return result


def _board(truth: SyntheticScenario) -> Board:
    board = truth.board_config
    return Board(
        columns=board.squares_x - 1,
        rows=board.squares_y - 1,
        square=board.square_size,
        square_sigma=0.0,
        coding=Charuco(board.marker_size, board.dictionary),
    )


def _views(task: Task, name: str) -> list[View]:
    """Return the views of a camera: a picture has the number of its frame."""
    views = []
    for index, frame in task.detections.frames.items():
        if name not in frame.detections:
            continue
        corners = frame.detections[name]
        pixels = np.full((task.board.num_corners, 2), np.nan)
        pixels[corners.corner_ids] = corners.corners_2d
        views.append(View(f"{index:04d}.png", pixels, np.isfinite(pixels[:, 0]).astype(float)))
    return views


def _table(title: str, rows: Mapping[str, Sequence[Errors]]) -> Table:
    table = Table(title=title)
    table.add_column("")
    for column in (
        "focal, %",
        "height, mm",
        "lengths, exact px, mm",
        "mean",
        "lengths, noisy px, mm",
        "mean",
        "lengths",
        "CPU, s",
    ):
        table.add_column(column, justify="right")
    for name, errors in rows.items():
        exact = 1000 * np.concatenate([row.exact for row in errors])
        noisy = 1000 * np.concatenate([row.noisy for row in errors])
        table.add_row(
            name,
            f"{100 * _rms(np.concatenate([row.focal for row in errors])):.3f}",
            f"{1000 * _rms(np.concatenate([row.height for row in errors])):.2f}",
            *(_length_cells(exact) + _length_cells(noisy)),
            f"{len(noisy)}",
            f"{np.mean([row.seconds for row in errors]):.1f}",
        )
    return table


def _length_cells(errors: Array) -> list[str]:
    """Return the root mean square and the signed mean of (L,) mm."""
    if not len(errors):
        return ["", ""]
    return [f"{_rms(errors):.3f}", f"{np.mean(errors):+.3f}"]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
