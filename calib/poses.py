"""Where the board was in each view: a start from the pinhole model, then refined through the whole ray path."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.observations import Observations
from calib.optics.lens import COEFFICIENTS
from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.rays import Rays
from calib.optics.target import Plane
from calib.solve import Linearised, Solution, minimise


def pinhole_poses(observations: Observations, values: Values) -> Tensor:
    """Each view's pose as if there were no cover, by perspective-n-point and its refinement (the paper's section 4.2, step 1).

    Returns:
        (V, 6) T_camera_board, rotation vector (rad) and translation (m); NaN for a view whose corners admit no pose.
    """
    camera, coefficients = opencv_intrinsics(values)
    poses = [
        _pnp(corners.numpy(), pixels.numpy(), camera, coefficients)
        for corners, pixels in zip(observations.per_view(observations.corners), observations.per_view(observations.pixels), strict=True)
    ]
    return torch.from_numpy(np.stack(poses)) if poses else torch.zeros(0, 6, dtype=torch.float64)


def opencv_intrinsics(values: Values) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """OpenCV's (3, 3) camera matrix and its (n,) distortion coefficients."""
    fx, fy, cx, cy = (float(values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy"))
    names = [f"camera.{name}" for name in COEFFICIENTS if f"camera.{name}" in values]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array([float(values[name]) for name in names])


def refine_poses(path: Path, values: Values, observations: Observations, poses: Tensor) -> Solution:
    """Each view's pose through the cover, with the paper's objective: squared distances on the board (section 3, equation 2).

    Args:
        poses: (V, 6) to start from.

    Returns:
        The solution; its blocks are the (V, 6) poses.
    """
    problem = _PoseProblem(path.trace(observations.pixels, values), path.target, observations)
    return minimise(problem, torch.zeros(0, dtype=torch.float64), poses)


@dataclass(frozen=True, slots=True)
class _PoseProblem:
    """Rays are fixed, boards move."""

    rays: Rays
    target: Plane
    observations: Observations

    @property
    def starts(self) -> Tensor:
        return self.observations.starts

    @property
    def precision(self) -> Tensor:
        return torch.zeros(0, 0, dtype=torch.float64)

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        del shared
        return float((self._weighted(blocks[self.observations.view]) ** 2).sum())

    def linearise(self, shared: Tensor, blocks: Tensor) -> Linearised:
        poses = blocks[self.observations.view].requires_grad_()
        residual = self._weighted(poses)
        (by_pose,) = by_row(residual, [poses])
        return Linearised(residual.detach(), by_pose, torch.zeros(*residual.shape, shared.shape[0], dtype=residual.dtype))

    def _weighted(self, poses: Tensor) -> Tensor:
        landed, failure = self.target(self.rays, poses)
        off = (landed - self.observations.corners) * self.observations.weight.unsqueeze(-1)
        # A ray that never left the cover says nothing of the board; one that now misses the board forbids the step.
        off = torch.where((self.rays.failure != 0).unsqueeze(-1), torch.zeros_like(off), off)
        return torch.where(((failure != 0) & (self.rays.failure == 0)).unsqueeze(-1), torch.full_like(off, torch.inf), off)


def _pnp(
    corners: NDArray[np.float64], pixels: NDArray[np.float64], camera: NDArray[np.float64], coefficients: NDArray[np.float64]
) -> NDArray[np.float64]:
    if len(corners) < 4:
        return np.full(6, np.nan)
    points = np.column_stack([corners, np.zeros(len(corners))])
    try:
        found, rotvec, translation = cv2.solvePnP(points, pixels, camera, coefficients, flags=cv2.SOLVEPNP_IPPE)
        if not found:
            return np.full(6, np.nan)
        rotvec, translation = cv2.solvePnPRefineLM(points, pixels, camera, coefficients, rotvec, translation)
    except cv2.error:  # corners on one line, or nowhere near a plane
        return np.full(6, np.nan)
    pose = np.concatenate([np.ravel(rotvec), np.ravel(translation)]).astype(np.float64)
    return pose if np.isfinite(pose).all() and pose[5] > 0 else np.full(6, np.nan)
