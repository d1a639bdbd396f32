"""Whether the maps are as sure as they say: `python -m benchmarks.uncertainty [--repeats 50]`.

Each repeat draws new glass, new board poses and new noise, calibrates, and compares the undistorted position of pixels near the training
corners with that of the true rays, after the rigid motion of all rays that fits best at the training corners. A ratio of error to
predicted sigma with a root mean square of 1 is honest; above, the prediction is too small.
"""

import argparse
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial import cKDTree

from calib.apply.map_uncertainty import predicted_sigma
from calib.calibration import Calibration
from calib.fitting.stages import Settings, Setup, fit_stages
from calib.optics.path import Path
from calib.progress import Silent
from calib.session.camera import Camera
from calib.threads import single_thread
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, paper_cone, scene

Array = NDArray[np.float64]

GLASS = paper_cone(thickness=0.00115)
DEPTHS = (0.3, 0.6, 1.2)
"""m: half the nearest training depth, and both ends."""
NEAR = 150.0
"""px: a pixel counts with three training corners that near."""
CAMERA = Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS)


def calibrate(made: Scene, settings: Settings) -> Calibration:
    """The calibration that a session with these corners gives."""
    found = fit_stages(Setup(made.board, CAMERA, INTRINSICS, made.cover), made.observations, settings, Silent())
    joint = found.joint
    return Calibration(
        board=made.board,
        camera=CAMERA,
        cover=made.cover,
        relief=found.relief,
        amplitudes=found.values["relief.amplitudes"].numpy() if found.relief else np.zeros((0, 0)),
        exact_hit=True,
        views=made.views,
        poses=found.poses.numpy(),
        covariance=joint.covariance.numpy() if joint else np.zeros((0, 0)),
        rejected=(),
        stages=found.stages,
        noise_px=joint.sigma if joint else float("nan"),
        settings={},
        gauge="",
    )


def errors(made: Scene, calibration: Calibration) -> Iterator[tuple[Array, Array]]:
    """For each depth the (N,) px errors of pixels near training corners, and their (N,) px predicted sigmas."""
    corners = made.observations.pixels.numpy()
    lattice = np.stack(np.meshgrid(np.linspace(50, WIDTH - 50, 40), np.linspace(50, HEIGHT - 50, 30)), -1).reshape(-1, 2)
    lattice = lattice[np.asarray(cKDTree(corners).query(lattice, k=3)[0])[:, 2] <= NEAR]
    path, values = calibration.model()
    depth = path.place(made.observations.corners, made.values, made.poses[made.observations.view])[:, 2].numpy()
    ours, true = (rays_of(p, v, corners) for p, v in ((path, values), (made.path, made.values)))
    motion = np.linalg.lstsq(motions(*ours, depth), (seen_at(*true, depth) - seen_at(*ours, depth)).ravel(), rcond=None)[0]
    ours, true = (rays_of(p, v, lattice) for p, v in ((path, values), (made.path, made.values)))
    field = predicted_sigma(calibration)
    assert field
    for metres in DEPTHS:
        at = np.full(len(lattice), metres)
        off = seen_at(*true, at) - seen_at(*ours, at) - (motions(*ours, at) @ motion).reshape(-1, 2)
        yield np.linalg.norm(off, axis=-1), field.at(lattice[:, :1], lattice[:, 1:], metres)[:, 0].astype(np.float64)


def rays_of(path: Path, values: dict[str, torch.Tensor], pixels: Array) -> tuple[Array, Array]:
    rays = path.trace(torch.from_numpy(pixels), values)
    return rays.origin.stacked().numpy(), rays.direction.stacked().numpy()


def seen_at(origins: Array, directions: Array, depth: Array) -> Array:
    """(N, 2) undistorted px at (N,) depths, without the principal point."""
    along = ((depth - origins[:, 2]) / directions[:, 2])[:, None]
    return np.asarray(INTRINSICS.fx.value * (origins + along * directions)[:, :2] / depth[:, None])


def motions(origins: Array, directions: Array, depth: Array) -> Array:
    """(2N, 6): how a small rotation (rad) and translation (m) of all rays move `seen_at`, by differences."""
    columns = []
    for axis in np.eye(3):
        turned = origins + 1e-6 * np.cross(axis, origins), directions + 1e-6 * np.cross(axis, directions)
        columns.append((seen_at(*turned, depth) - seen_at(origins, directions, depth)).ravel() / 1e-6)
    for axis in np.eye(3):
        columns.append((seen_at(origins + 1e-6 * axis, directions, depth) - seen_at(origins, directions, depth)).ravel() / 1e-6)
    return np.stack(columns, -1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=50)
    repeats = parser.parse_args().repeats
    table = Table("glass", *(f"{depth} m: error, predicted px; ratio" for depth in DEPTHS), "ratio in all")
    with single_thread():
        for bumps, amplitude in ((4, 1e-5), (10, 1e-5)):
            squares = np.zeros((len(DEPTHS), 3))
            for seed in track(range(100, 100 + repeats), f"{bumps}x{bumps} bumps"):
                made = scene(seed, 20, (bumps, bumps), amplitude, 0.1, cover=GLASS)
                for row, (error, sigma) in zip(squares, errors(made, calibrate(made, Settings())), strict=True):
                    row += np.mean(error**2), np.mean(sigma**2), np.mean((error / sigma) ** 2)
            roots = np.sqrt(squares / repeats)
            cells = (f"{error:.3f}, {sigma:.3f}; {ratio:.2f}" for error, sigma, ratio in roots)
            table.add_row(f"{bumps}x{bumps}, {amplitude:g} m", *cells, f"{np.sqrt((roots[:, 2] ** 2).mean()):.2f}")
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
