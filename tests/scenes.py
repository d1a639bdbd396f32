"""Synthetic sessions of known truth, made with the forward projection. What it rests on is tested against other oracles."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from calib.board import Board
from calib.camera import Intrinsics
from calib.cover import Cover
from calib.observations import Observations
from calib.optics.build import covered_path, with_relief
from calib.optics.path import Path
from calib.optics.project import project
from calib.optics.relief import Relief
from calib.schema import Number
from calib.views import View

WIDTH, HEIGHT = 3280, 2464
INTRINSICS = Intrinsics(Number(2558.36), Number(2558.36), Number(1666.03), Number(1273.65))
Patch = tuple[tuple[float, float], tuple[float, float]]
PATCH: Patch = (-0.010, -np.pi / 12), (0.010, np.pi / 12)
"""The paper's 20 mm by 30 degrees, as low and high (y, theta)."""


def paper_cone(thickness: float = 0.003) -> Cover:
    """The paper's Fig. 1b."""
    numbers = {
        "inner_radius": 0.04195,
        "radius_slope": -0.105,
        "axis_offset.x": 0.0,
        "axis_offset.z": -0.030,
        "tilt.x": 0.0,
        "tilt.z": 0.0,
        "thickness": thickness,
        "refractive_index": 1.5,
        "outside_index": 1.0,
    }
    return Cover("cone", {name: Number(value) for name, value in numbers.items()})


@dataclass(frozen=True)
class Scene:
    board: Board
    cover: Cover
    path: Path
    values: dict[str, Tensor]
    poses: Tensor
    views: tuple[View, ...]

    @property
    def observations(self) -> Observations:
        return Observations.of(self.views, self.board)


def scene(
    seed: int,
    views: int = 10,
    grid: tuple[int, int] = (4, 4),
    amplitude: float = 1e-5,
    noise: float = 0.0,
    depths: tuple[float, float] = (0.6, 1.2),
    cover: Cover | None = None,
    board: Board | None = None,
    patch: Patch = PATCH,
) -> Scene:
    """Boards at random poses, every corner within the image, seen through a cover (the paper's cone) with random bumps on a patch of it."""
    rng = np.random.default_rng(seed)
    board = board or Board(9, 9, 0.020)
    cover = cover or paper_cone()
    relief = Relief(*patch, grid)
    smooth, values = covered_path(INTRINSICS, cover)
    path = with_relief(smooth, relief)
    values["relief.amplitudes"] = torch.from_numpy(rng.normal(amplitude, amplitude / 4, grid))
    kept: list[View] = []
    poses: list[Tensor] = []
    while len(kept) < views:
        pose = torch.from_numpy(_random_pose(rng, depths))
        pixels = project(path, values, path.place(torch.from_numpy(board.points()), values, pose)).numpy()
        if not np.all((pixels >= 20) & (pixels <= [WIDTH - 20, HEIGHT - 20])):
            continue
        pixels = pixels + rng.normal(0, noise, pixels.shape) if noise else pixels
        kept.append(View(f"{len(kept):04d}.png", pixels, np.ones(board.count)))
        poses.append(pose)
    return Scene(board, cover, path, values, torch.stack(poses), tuple(kept))


def _random_pose(rng: np.random.Generator, depths: tuple[float, float]) -> np.ndarray:
    depth = rng.uniform(*depths)
    across = rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth
    return np.concatenate([rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.3, 0.3, 1), across, [depth]])
