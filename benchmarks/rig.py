"""Lengths by simulated pairs of cameras behind covers, beside OpenCV's stereo calibration on the
same corners: `python -m benchmarks.rig [--rigs N]`; and how the estimate grows with the
placements: `python -m benchmarks.rig --growth CAMERAS`.

Two cameras are 60 mm apart, each behind its own cover: an uneven cone of 1.15 mm, an uneven dome in
air, or a flat window in water. That of the last kind is the sea's, 1.340, and declared as 1.333. 30
pictures of one board at 0.4 to 1.2 m, 0.1 px of noise. Every
declared number is off by a draw of `fixtures.rigs.DECLARED`. The distances of 400 points at 0.2 to
2 m are measured, 2 to a pair, within each band of depth.

- error over sigma: root mean square over the distances of all rigs, with exact pixels (the
  calibration's own part) and with 0.1 px of noise in the points; and the part of the distances
  whose error is above 2.5 sigma.
- error: root mean square, mm, by depth, with exact pixels.
- OpenCV: calibrateCamera with 14 coefficients for each camera, then stereoCalibrate of all numbers,
  then triangulation of the undistorted pixels.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import UNEVEN_GLASS
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.optics.build import covered_path, with_relief
from calib.optics.relief import Relief
from calib.rig.fit_rig import fit_rig
from calib.rig.joint_estimate import CameraState, RigState
from calib.rig.layout import RigLayout
from calib.rig.shared_medium import shared_media
from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.rigs import SimulatedRig, simulate_rig, with_declared_medium
from fixtures.synthetic import (
    BUMPS,
    DOME_PLACE,
    FLAT_PLACE,
    HEIGHT,
    INTRINSICS,
    PATCH,
    THIN,
    WATER,
    WIDTH,
    Patch,
    glass,
)

POINTS = 400
SEA = 1.340
"""The index of sea water."""
BANDS = (0.2, 0.4, 0.7, 1.2, 2.0)
"""m: the bands of depth."""
NOISE_PX = 0.1
PLACEMENTS = (125, 250, 500)
"""The placements of the boards whose estimates' growth is measured."""
GRID = (12, 12)
"""The centres of each relief there."""
FLAGS = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL
"""The 14 coefficients of OpenCV."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of rig."""

    cover: Cover
    amplitude: float = 0.0
    patch: Patch = PATCH
    declared_index: float | None = None
    """The index outside that the sessions declare; None for the true one."""


KINDS = {
    "cone": Kind(THIN, BUMPS),
    "dome": Kind(glass("dome", 0.003, **DOME_PLACE), BUMPS, ((-0.5, -0.5), (0.5, 0.5))),
    "window in water": Kind(glass("flat", 0.006, outside_index=WATER, **FLAT_PLACE)),
    "window in the sea": Kind(
        glass("flat", 0.006, outside_index=SEA, **FLAT_PLACE), declared_index=WATER
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class Lengths:
    """The measured distances of one rig."""

    depth: Array
    """(M,) m"""
    error: Array
    """(M,) m, with exact pixels."""
    normalised: Array
    """(M,) error over sigma with exact pixels."""
    noisy: Array
    """(M,) error over sigma with noise in the pixels."""
    peer: Array
    """(M,) m, the error of OpenCV with exact pixels."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=5, help="rigs of each kind (default: 5)")
    parser.add_argument("--kind", choices=KINDS, action="append", help="only this kind")
    growth = "only the growth of the estimate, with this many cameras"
    parser.add_argument("--growth", type=int, metavar="CAMERAS", help=growth)
    options = parser.parse_args()
    console = Console(soft_wrap=True)
    if options.growth:
        print_growth(options.growth, console)
        return
    for name in options.kind or KINDS:
        results = [measure(KINDS[name], seed) for seed in range(options.rigs)]
        console.print(_table(name, results))


def print_growth(cameras: int, console: Console) -> None:
    """Print the CPU time of one linearisation with the elimination of all placements, and the size
    of its equations and the peak of the process's memory, for several numbers of placements.
    """
    for placements in PLACEMENTS:
        state = uneven_state(cameras, placements)
        problem = state.problem()
        start = time.process_time()
        equations = problem.linearisation(state.vector(), state.placements).equations
        reduced = equations.eliminate_blocks()
        seconds = time.process_time() - start
        tensors = (equations.hessian_cross, equations.hessian_block, equations.hessian_shared)
        size = sum(tensor.numel() * tensor.element_size() for tensor in tensors) / 1e6
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        console.print(
            f"{cameras} cameras, {placements} placements, {len(reduced.gradient)} numbers:"
            f" {seconds:.1f} s, equations {size:.0f} MB, peak {peak:.0f} MB"
        )


def uneven_state(cameras: int, placements: int) -> RigState:
    """Return the start of an estimate of cameras behind uneven cones, which all see every board.
    Their mountings are alike, so that they do.
    """
    names = tuple(f"camera{index}" for index in range(cameras))
    simulated = simulate_rig(0, THIN, placements=placements, amplitude=0.0, names=names[:2])
    first, second = simulated.cameras
    states = []
    mountings = []
    for index, name in enumerate(names):
        source = second if index else first
        camera = simulated.cameras[source]
        path, means = covered_path(camera.intrinsics, camera.cover)
        path = with_relief(path, Relief(*PATCH, GRID))
        means["relief.amplitudes"] = torch.zeros(GRID, dtype=torch.float64)
        priors = priors_of(camera.intrinsics, camera.cover, path)
        model = CameraModel(path, means, priors)
        observations = Observations.of(simulated.views[source], simulated.board)
        place = torch.arange(placements)
        state = CameraState(name, model, observations, place, means, NOISE_PX, UNEVEN_GLASS)
        states.append(state)
        mountings.append(camera.mounting)
    nominal = torch.stack(mountings)
    layout = RigLayout.of(names, [state.model for state in states], names[0])
    return RigState(tuple(states), layout, nominal, nominal, simulated.placements)


def measure(kind: Kind, seed: int) -> Lengths:
    """Fit one rig and measure its distances."""
    simulated = simulate_rig(seed, kind.cover, amplitude=kind.amplitude, patch=kind.patch)
    if kind.declared_index:
        simulated = with_declared_medium(simulated, Number(kind.declared_index))
    points, pixels = simulated.points(seed + 1000, POINTS)
    pairs = _pairs(points, seed)
    offset = points[pairs[:, 1]] - points[pairs[:, 0]]
    true = np.linalg.norm(offset, axis=-1)
    with tempfile.TemporaryDirectory() as folder:
        rig = fit_rig(simulated.write(Path(folder)))
    for medium in shared_media(rig):
        index = medium.index
        print(f"rig {seed}: index of {medium.word} {index.value:.5f} +- {index.sigma:.5f}")
    length, sigma = rig.distances(pixels, pairs, 0.0)
    rng = np.random.default_rng(seed + 2000)
    noisy = {
        name: places + rng.normal(0, NOISE_PX, places.shape) for name, places in pixels.items()
    }
    noisy_length, noisy_sigma = rig.distances(noisy, pairs, NOISE_PX)
    peer = _opencv(simulated)(pixels)
    peer_length = np.linalg.norm(peer[pairs[:, 1]] - peer[pairs[:, 0]], axis=-1)
    return Lengths(
        depth=points[pairs, 2].mean(-1),
        error=length - true,
        normalised=(length - true) / sigma,
        noisy=(noisy_length - true) / noisy_sigma,
        peer=peer_length - true,
    )


def _pairs(points: Array, seed: int) -> NDArray[np.int64]:
    """Return (M, 2) pairs of points within each band of depth."""
    rng = np.random.default_rng(seed)
    pairs = []
    for low, high in pairwise(BANDS):
        members = np.flatnonzero((points[:, 2] >= low) & (points[:, 2] < high))
        shuffled = rng.permutation(members)
        half = len(shuffled) // 2
        pairs.append(np.column_stack([shuffled[:half], shuffled[half : 2 * half]]))
    return np.concatenate(pairs)


def _opencv(rig: SimulatedRig) -> Callable[[Mapping[str, Array]], Array]:
    """Return a function from the pixels of both cameras to (N, 3) m points, by OpenCV."""
    first, second = rig.cameras
    board = np.column_stack([rig.board.points(), np.zeros(rig.board.count)]).astype(np.float32)
    boards = [board] * len(rig.placements)
    corners = {
        name: [view.corners.astype(np.float32) for view in views]
        for name, views in rig.views.items()
    }
    k = INTRINSICS
    start = np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])
    lenses = {}
    for name, places in corners.items():
        _, camera, lens, *_ = cv2.calibrateCamera(
            boards,
            places,
            (WIDTH, HEIGHT),
            start.copy(),
            np.zeros(14),
            flags=FLAGS | cv2.CALIB_USE_INTRINSIC_GUESS,
        )
        lenses[name] = camera, lens
    _, camera_1, lens_1, camera_2, lens_2, turn, shift, *_ = cv2.stereoCalibrate(
        boards,
        corners[first],
        corners[second],
        *lenses[first],
        *lenses[second],
        (WIDTH, HEIGHT),
        flags=FLAGS | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-9),
    )

    def triangulate(pixels: Mapping[str, Array]) -> Array:
        flat = [
            cv2.undistortPoints(np.ascontiguousarray(pixels[name]).reshape(-1, 1, 2), camera, lens)
            for name, camera, lens in ((first, camera_1, lens_1), (second, camera_2, lens_2))
        ]
        homogeneous = cv2.triangulatePoints(
            np.eye(3, 4),
            np.column_stack([turn, shift]),
            flat[0].reshape(-1, 2).T,
            flat[1].reshape(-1, 2).T,
        )
        return np.asarray((homogeneous[:3] / homogeneous[3]).T, np.float64)

    return triangulate


def _table(name: str, results: list[Lengths]) -> Table:
    depth = np.concatenate([result.depth for result in results])
    table = Table(title=f"{name}: {len(results)} rigs")
    for column in ("depth, m", "error / sigma", "with 0.1 px", "above 2.5", "mm", "OpenCV, mm"):
        table.add_column(column, justify="right")
    rows = [*pairwise(BANDS), (BANDS[0], BANDS[-1])]
    for low, high in rows:
        members = (depth >= low) & (depth < high)
        normalised = np.concatenate([result.normalised for result in results])[members]
        noisy = np.concatenate([result.noisy for result in results])[members]
        error = np.concatenate([result.error for result in results])[members]
        peer = np.concatenate([result.peer for result in results])[members]
        table.add_row(
            f"{low} to {high}",
            f"{_rms(normalised):.2f}",
            f"{_rms(noisy):.2f}",
            f"{100 * np.mean(np.abs(normalised) > 2.5):.1f} %",
            f"{1000 * _rms(error):.3f}",
            f"{1000 * _rms(peer):.3f}",
        )
    return table


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
