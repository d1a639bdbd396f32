"""Scenes of known truth, and the error that the truth itself leaves on their noisy corners."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.peers.case import BOARD, CORNERS, Case, Shots
from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, paper_cone, scene

TRAINED, TESTED = 45, 20
"""Views."""
NOISE = 0.1  # px per axis
NEAR = (0.15, 0.30)  # m
FEWEST = 20
"""Corners in the picture, for a near view to count."""
MARGIN = 20.0  # px


@dataclass(frozen=True, slots=True)
class Glass:
    """The glass, which differs between scenes."""

    thickness: float
    """m"""
    bumps: int
    """Along each side of the patch."""
    amplitude: float
    """m, the bumps' mean; their standard deviation is a quarter of it."""

    def __str__(self) -> str:
        return (
            f"glass of {1e3 * self.thickness:g} mm, {self.bumps}x{self.bumps} bumps of"
            f" {1e6 * self.amplitude:g} um"
        )


GLASSES = tuple(Glass(t, n, a) for t in (0.00115, 0.003) for n in (4, 10) for a in (1e-5, 3e-5))


def make(glass: Glass, seed: int) -> tuple[Case, tuple[float, float]]:
    """A scene, and what its true glass leaves on the test and near views, px RMS, with their poses
    refitted.
    """
    cover = paper_cone(glass.thickness)
    made = scene(
        seed,
        TRAINED + TESTED,
        (glass.bumps, glass.bumps),
        glass.amplitude,
        NOISE,
        cover=cover,
        board=BOARD,
    )
    pixels, poses = np.stack([view.corners for view in made.views]), made.poses.numpy()
    near = _near(made.path, made.values, np.random.default_rng((seed, 1)))
    sets = Shots(pixels[:TRAINED], poses[:TRAINED]), Shots(pixels[TRAINED:], poses[TRAINED:]), near
    floor = left(made.path, made.values, sets[1]), left(made.path, made.values, near)
    return Case(glass.thickness, (WIDTH, HEIGHT), INTRINSICS.fx.value, *sets), floor


def views(shots: Shots) -> list[View]:
    weights = shots.seen.astype(np.float64)
    return [
        View(f"{i:04d}.png", corners, weight)
        for i, (corners, weight) in enumerate(zip(shots.pixels, weights, strict=True))
    ]


def observed(shots: Shots) -> Observations:
    return Observations.of(views(shots), BOARD)


def left(path: Path, values: Values, shots: Shots) -> float:
    """px RMS through a refractive model with each view's pose refitted; NaN if it does not see a
    corner that was seen.
    """
    residual = refit_poses(path, values, observed(shots), torch.from_numpy(shots.poses))[1]
    return float((residual.image**2).sum(-1).mean().sqrt())


def _near(path: Path, values: Values, rng: np.random.Generator) -> Shots:
    chosen: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    while len(chosen) < TESTED:
        depth = rng.uniform(*NEAR)
        sideways = rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth
        pose = np.concatenate(
            [rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.3, 0.3, 1), sideways, [depth]]
        )
        points = path.place(
            torch.from_numpy(CORNERS[:, :2]), values, torch.from_numpy(pose), MIDDLE
        )
        pixels = project(path, values, points, MIDDLE).numpy()
        in_picture = np.all(
            (pixels >= MARGIN) & (pixels <= [WIDTH - MARGIN, HEIGHT - MARGIN]), -1
        )  # false for NaN
        if in_picture.sum() < FEWEST:
            continue
        noisy = pixels + rng.normal(0, NOISE, pixels.shape)
        chosen.append((np.where(in_picture[:, None], noisy, np.nan), pose))
    return Shots(np.stack([pixels for pixels, _ in chosen]), np.stack([pose for _, pose in chosen]))
