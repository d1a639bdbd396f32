"""The error of a calibrated rig on placements of the board, by the same code for every program.

It imports no program that is compared, so that each one's own Python can run it. Frames: the rig's
is that of its reference camera, the board's has its corners near z = 0. A placement has the name of
its pictures.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

STEPS = 50
"""The most steps of the placements' fit."""
FIRST_STEPS = 5
"""The steps after which the better of a placement's two starts is chosen."""
TOLERANCE = 1e-8
"""The fit of the placements ends when no step promises to lower the squares by this fraction."""
DIFFERENCE = 1e-6
"""rad and m: the step of the derivatives by a pose."""
SETTLED = 1e-8
"""rad and m: a mounting is found when its step is smaller."""
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
    """The squares of a rig's errors in P placements, px^2, each the sum of x and y."""

    corners: Mapping[str, Floats]
    """By camera, (P,) the numbers of corners that it saw."""
    squares: Mapping[str, Floats]
    """By camera, (P,) the sums over its corners, with one pose of the board for all cameras."""
    products: Floats
    """(P,) the sums of the products of the first two cameras' errors, over the corners of both."""
    crossed: Floats
    """(P,) the sums over all cameras' corners, each half with the pose that the rest gives."""

    @property
    def total(self) -> Floats:
        """(P,) px^2: the sums over the corners of all cameras."""
        return _total(self.squares)

    @property
    def rms_px(self) -> float:
        return float(np.sqrt(self.total.sum() / _total(self.corners).sum()))

    @property
    def crossed_px(self) -> float:
        return float(np.sqrt(self.crossed.sum() / _total(self.corners).sum()))

    @property
    def correlation(self) -> float:
        """The correlation of the first two cameras' errors. The board moves and bends for both;
        their own lenses and mountings err for one.
        """
        first, second, *_ = self.squares.values()
        return float(self.products.sum() / np.sqrt(first.sum() * second.sum()))

    @property
    def by_placement(self) -> Floats:
        """(P,) px: the error of each placement."""
        return np.sqrt(self.total / _total(self.corners))

    def of_camera(self, name: str) -> float:
        """Return the error of one camera, px."""
        return float(np.sqrt(self.squares[name].sum() / self.corners[name].sum()))

    def document(self) -> dict[str, object]:
        """Return the score as JSON has it."""
        return {
            "corners": {name: numbers.tolist() for name, numbers in self.corners.items()},
            "squares": {name: numbers.tolist() for name, numbers in self.squares.items()},
            "products": self.products.tolist(),
            "crossed": self.crossed.tolist(),
        }

    @staticmethod
    def of_document(document: Mapping[str, Any]) -> "Score":
        return Score(
            {name: np.array(numbers) for name, numbers in document["corners"].items()},
            {name: np.array(numbers) for name, numbers in document["squares"].items()},
            np.array(document["products"]),
            np.array(document["crossed"]),
        )

    @staticmethod
    def join(scores: Sequence["Score"]) -> "Score":
        """Return the score of the placements of several scores."""
        names = scores[0].corners
        return Score(
            {name: np.concatenate([score.corners[name] for score in scores]) for name in names},
            {name: np.concatenate([score.squares[name] for score in scores]) for name in names},
            np.concatenate([score.products for score in scores]),
            np.concatenate([score.crossed for score in scores]),
        )


def score(cameras: Mapping[str, PlacedCamera], corners: Mapping[str, Floats]) -> Score:
    """Return the errors with one pose of the board for all cameras in each placement.

    Args:
        cameras: the cameras of the rig, the reference first.
        corners: by camera, the (P, B, 2) px corners of the placements; NaN for those not seen.
    """
    start = first_poses(cameras, corners)
    poses = fit_poses(cameras, corners, start)
    odd = np.arange(next(iter(corners.values())).shape[1]) % 2 == 1
    crossed = np.zeros(len(poses))
    for half in (odd, ~odd):
        fitted = {name: _only(half, rows) for name, rows in corners.items()}
        scored = {name: _only(~half, rows) for name, rows in corners.items()}
        rest = fit_poses(cameras, fitted, start)
        crossed += (_residuals(cameras, rest, scored) ** 2).sum(-1)
    errors = {name: _residuals({name: camera}, poses, corners) for name, camera in cameras.items()}
    first, second, *_ = errors.values()
    return Score(
        corners={name: np.isfinite(rows[..., 0]).sum(-1) for name, rows in corners.items()},
        squares={name: (residual**2).sum(-1) for name, residual in errors.items()},
        products=(first * second).sum(-1),
        crossed=crossed,
    )


def with_best_mounting(
    cameras: Mapping[str, PlacedCamera], name: str, corners: Mapping[str, Floats]
) -> dict[str, PlacedCamera]:
    """Return the cameras with the mounting of one of them that has the least squares of the corners
    of some placements, whose poses are fitted with it, by Gauss and Newton's steps.
    """
    poses = first_poses(cameras, corners)
    for _ in range(STEPS):
        poses = fit_poses(cameras, corners, poses)
        camera = cameras[name]
        residual = _residuals(cameras, poses, corners)
        by_pose = _by_pose(cameras, poses, corners, residual)
        slopes = []
        for change in DIFFERENCE * np.eye(6):
            moved = {**cameras, name: replace(camera, mounting=camera.mounting + change)}
            slopes.append((_residuals(moved, poses, corners) - residual) / DIFFERENCE)
        rows = np.concatenate([np.stack(slopes, -1), residual[..., None]], -1)  # (P, R, 7)
        basis = np.linalg.qr(by_pose)[0]
        rows = (rows - basis @ (np.swapaxes(basis, 1, 2) @ rows)).reshape(-1, 7)
        step = np.linalg.lstsq(rows[:, :6], -rows[:, 6], rcond=None)[0]
        cameras = {**cameras, name: replace(camera, mounting=camera.mounting + step)}
        if np.abs(step).max() < SETTLED:
            break
    return dict(cameras)


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
    fits = [fit_poses(cameras, corners, start, FIRST_STEPS) for start in starts]
    costs = [_costs(_residuals(cameras, poses, corners)) for poses in fits]
    return np.where((costs[0] <= costs[1])[:, None], *fits)


def fit_poses(
    cameras: Mapping[str, PlacedCamera],
    corners: Mapping[str, Floats],
    start: Floats,
    steps: int = STEPS,
) -> Floats:
    """Return the (P, 6) T_reference_board of least squares of the corners in all cameras."""
    poses = start
    damping = np.full(len(poses), START_DAMPING)
    residual = _residuals(cameras, poses, corners)
    for _ in range(steps):
        jacobian = _by_pose(cameras, poses, corners, residual)
        hessian = np.einsum("pri,prj->pij", jacobian, jacobian)
        gradient = np.einsum("pri,pr->pi", jacobian, residual)
        diagonal = np.einsum("pii->pi", hessian)
        damped = hessian + (damping[:, None] * diagonal)[:, :, None] * np.eye(6)
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        moved = _residuals(cameras, poses + step, corners)
        costs = _costs(residual)
        better = _costs(moved) < costs
        promised = -(gradient * step).sum(-1)
        poses = np.where(better[:, None], poses + step, poses)
        residual = np.where(better[:, None], moved, residual)
        damping = np.clip(np.where(better, damping / 10, damping * 10), 1e-12, MAX_DAMPING)
        if (promised <= TOLERANCE * costs).all():
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


def _by_pose(
    cameras: Mapping[str, PlacedCamera],
    poses: Floats,
    corners: Mapping[str, Floats],
    residual: Floats,
) -> Floats:
    """Return the (P, R, 6) derivatives of the (P, R) residuals by the poses."""
    slopes = [
        (_residuals(cameras, poses + change, corners) - residual) / DIFFERENCE
        for change in DIFFERENCE * np.eye(6)
    ]
    return np.nan_to_num(np.stack(slopes, -1))


def _costs(residual: Floats) -> Floats:
    """Return the (P,) px^2 sums of squares, infinite where a camera cannot see a corner."""
    squares = (residual**2).sum(-1)
    return np.where(np.isnan(squares), np.inf, squares)


def _only(chosen: NDArray[np.bool_], corners: Floats) -> Floats:
    """Return the corners with NaN for those not chosen."""
    return np.where(chosen[:, None], corners, np.nan)


def _total(by_camera: Mapping[str, Floats]) -> Floats:
    total: Floats = np.sum(list(by_camera.values()), 0)
    return total
