"""The error of a calibrated rig on placements of the board, by the same code for every program.

It imports no program that is compared, so that each one's own Python can run it. Frames: the rig's
is that of its reference camera, the board's has its corners near z = 0. A placement has the name of
its pictures.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

STEPS = 50
"""The most steps of a placement's fit."""
TOLERANCE = 1e-10
"""The fit of the placements ends when a step lowers no placement's squares by this fraction."""
DIFFERENCE = 1e-6
"""rad and m: the step of the derivatives by a pose."""
START_DAMPING = 1e-4
MAX_DAMPING = 1e8


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera of a rig as its program projects."""

    project: Callable[[Floats], Floats]
    """From (N, 3) m points in the camera's frame to (N, 2) px, NaN for those that it cannot see."""
    mounting: Floats
    """(6,) T_camera_reference: a rotation vector, rad, and a translation, m."""
    board: Floats
    """(B, 3) m: the board's corners, with its shape and print as the program has them."""


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """The errors of a rig, px: two-dimensional root mean squares."""

    both: float
    """The error of all cameras, with one pose of the board for all."""
    cameras: Mapping[str, float]
    """The same of each camera."""
    halves: float
    """The error of each half of the corners, with the pose that the other half gives."""

    def document(self) -> dict[str, object]:
        return asdict(self)


def score(cameras: Mapping[str, PlacedCamera], corners: Mapping[str, Floats]) -> Score:
    """Return the errors with one pose of the board for all cameras in each placement.

    Args:
        cameras: the cameras of the rig, the reference first.
        corners: by camera, the (P, B, 2) px corners of the placements; NaN for those not seen.
    """
    start = first_poses(cameras, corners)
    squares = _squares(cameras, fit_poses(cameras, corners, start), corners)
    odd = np.arange(next(iter(corners.values())).shape[1]) % 2 == 1
    crossed = []
    for half in (odd, ~odd):
        fitted = {name: _only(half, rows) for name, rows in corners.items()}
        scored = {name: _only(~half, rows) for name, rows in corners.items()}
        crossed.append(_squares(cameras, fit_poses(cameras, fitted, start), scored))
    return Score(
        both=_root_mean([squares]),
        cameras={name: _root_mean([{name: rows}]) for name, rows in squares.items()},
        halves=_root_mean(crossed),
    )


def with_best_mounting(
    cameras: Mapping[str, PlacedCamera], name: str, corners: Mapping[str, Floats]
) -> dict[str, PlacedCamera]:
    """Return the cameras with the mounting of one of them that has the least squares of the corners
    of some placements, whose poses are fitted with it.
    """
    poses = fit_poses(cameras, corners, first_poses(cameras, corners))

    def placed(mounting: Floats) -> dict[str, PlacedCamera]:
        return {**cameras, name: replace(cameras[name], mounting=mounting)}

    def residual(mounting: Floats) -> Floats:
        moved = placed(mounting)
        return np.ravel(_residuals(moved, fit_poses(moved, corners, poses), corners))

    return placed(least_squares(residual, cameras[name].mounting, diff_step=1e-4, x_scale=0.01).x)


def first_poses(cameras: Mapping[str, PlacedCamera], corners: Mapping[str, Floats]) -> Floats:
    """Return (P, 6) T_reference_board from the reference camera, as if it were a pinhole camera: of
    the two poses of a plane that fit about equally well, the better for all cameras.
    """
    reference = next(iter(cameras))
    camera = cameras[reference]
    side = 0.01
    middle, right, below = camera.project(np.array([[0, 0, 1], [side, 0, 1], [0, side, 1]], float))
    focal = np.array([(right - middle)[0], (below - middle)[1]]) / side
    flat = camera.board * [1, 1, 0]
    candidates = []
    for rows in corners[reference]:
        visible = np.isfinite(rows[:, 0])
        rays = (rows[visible] - middle) / focal
        _, turns, places, _ = cv2.solvePnPGeneric(
            flat[visible], rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        poses = [np.ravel([turn, place]) for turn, place in zip(turns, places, strict=True)]
        candidates.append((poses[0], poses[-1]))
    starts = np.swapaxes(np.array(candidates), 0, 1)
    fits = [fit_poses(cameras, corners, start) for start in starts]
    costs = [_costs(cameras, poses, corners) for poses in fits]
    return np.where((costs[0] <= costs[1])[:, None], *fits)


def fit_poses(
    cameras: Mapping[str, PlacedCamera], corners: Mapping[str, Floats], start: Floats
) -> Floats:
    """Return the (P, 6) T_reference_board of least squares of the corners in all cameras."""
    poses = start
    costs = _costs(cameras, poses, corners)
    damping = np.full(len(poses), START_DAMPING)
    for _ in range(STEPS):
        residual = _residuals(cameras, poses, corners)
        slopes = []
        for column in range(6):
            step = DIFFERENCE * np.eye(6)[column]
            ahead = _residuals(cameras, poses + step, corners)
            behind = _residuals(cameras, poses - step, corners)
            slopes.append((ahead - behind) / (2 * DIFFERENCE))
        jacobian = np.nan_to_num(np.stack(slopes, -1))  # (P, R, 6)
        hessian = np.einsum("pri,prj->pij", jacobian, jacobian)
        gradient = np.einsum("pri,pr->pi", jacobian, residual)
        diagonal = np.einsum("pii->pi", hessian)
        damped = hessian + (damping[:, None] * diagonal)[:, :, None] * np.eye(6)
        moved = poses - np.linalg.solve(damped, gradient[..., None])[..., 0]
        moved_costs = _costs(cameras, moved, corners)
        better = moved_costs < costs
        change = np.where(better, 1 - moved_costs / costs, 0.0)
        poses = np.where(better[:, None], moved, poses)
        costs = np.where(better, moved_costs, costs)
        damping = np.clip(np.where(better, damping / 10, damping * 10), 1e-12, MAX_DAMPING)
        if change.max() < TOLERANCE and (better | (damping >= 1)).all():
            break
    return poses


def read_corners(file: Path) -> dict[str, Floats]:
    """Return the (B, 2) px corners of each picture of a corners file; NaN for those not seen."""
    rows: dict[str, list[list[float]]] = {}
    for line in file.read_text().splitlines():
        if line and not line.startswith("#"):
            name, x, y, *_ = line.split()
            corner = [math.nan, math.nan] if x == "-" else [float(x), float(y)]
            rows.setdefault(name, []).append(corner)
    return {name: np.array(corners) for name, corners in rows.items()}


def shared_corners(files: Mapping[str, Path]) -> dict[str, Floats]:
    """Return, by camera, the (P, B, 2) px corners of the pictures whose names all files have."""
    by_camera = {camera: read_corners(file) for camera, file in files.items()}
    names = shared_names(list(by_camera.values()))
    return {
        camera: np.stack([pictures[name] for name in names])
        for camera, pictures in by_camera.items()
    }


def shared_names(cameras: Sequence[Mapping[str, object]]) -> list[str]:
    """Return the names of the pictures that all cameras have, in order."""
    return sorted(set.intersection(*(set(pictures) for pictures in cameras)))


def _residuals(
    cameras: Mapping[str, PlacedCamera], poses: Floats, corners: Mapping[str, Floats]
) -> Floats:
    """Return (P, R) px differences of all cameras' corners, x and y; 0 for corners not seen."""
    placements = len(poses)
    differences = []
    for name, camera in cameras.items():
        mounting = Rotation.from_rotvec(camera.mounting[:3])
        turns = mounting * Rotation.from_rotvec(poses[:, :3])
        places = mounting.apply(poses[:, 3:]) + camera.mounting[3:]
        points = np.einsum("pij,bj->pbi", turns.as_matrix(), camera.board) + places[:, None]
        image = camera.project(points.reshape(-1, 3)).reshape(placements, -1, 2)
        difference = np.where(np.isnan(corners[name]), 0.0, image - corners[name])
        differences.append(difference.reshape(placements, -1))
    return np.concatenate(differences, 1)


def _costs(
    cameras: Mapping[str, PlacedCamera], poses: Floats, corners: Mapping[str, Floats]
) -> Floats:
    """Return the (P,) px^2 sums of squares, infinite where a camera cannot see a corner."""
    squares = (_residuals(cameras, poses, corners) ** 2).sum(-1)
    return np.where(np.isnan(squares), np.inf, squares)


def _squares(
    cameras: Mapping[str, PlacedCamera], poses: Floats, corners: Mapping[str, Floats]
) -> dict[str, Floats]:
    """Return, by camera, the px^2 of each corner that it saw."""
    squares = {}
    for name, camera in cameras.items():
        pair = _residuals({name: camera}, poses, {name: corners[name]}).reshape(len(poses), -1, 2)
        squares[name] = (pair**2).sum(-1)[np.isfinite(corners[name][..., 0])]
    return squares


def _only(chosen: NDArray[np.bool_], corners: Floats) -> Floats:
    """Return the corners with NaN for those not chosen."""
    return np.where(chosen[:, None], corners, np.nan)


def _root_mean(squares: Sequence[Mapping[str, Floats]]) -> float:
    rows = [row for by_camera in squares for row in by_camera.values()]
    return float(np.sqrt(np.concatenate(rows).mean()))
