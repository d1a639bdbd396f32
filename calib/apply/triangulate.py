"""The intersection of rays with a plane, the point nearest to several rays, and derivatives by
central differences.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from calib.optics import rotation
from calib.undistortion.grids import Array

WEIGHTINGS = 3
"""The number of rounds that weight a point's rays by their lengths to the point of the last round.
"""
PARALLEL = 1e12
"""The condition number from which rays count as parallel."""


def turns(poses: Array) -> Array:
    """Return the (N, 3, 3) rotations of (N, 6) poses."""
    return rotation.matrix(torch.from_numpy(np.ascontiguousarray(poses[:, :3]))).numpy()


def intersect(origins: Array, directions: Array, poses: Array) -> Array:
    """Return the (N, 3) m points where rays intersect the x-y planes of (N, 6) poses; NaN where
    they do not.
    """
    normals = turns(poses)[:, :, 2]
    towards = (directions * normals).sum(-1)
    distance = ((poses[:, 3:] - origins) * normals).sum(-1) / np.where(
        np.abs(towards) < 1e-9, np.nan, towards
    )
    return np.asarray(origins + np.where(distance > 0, distance, np.nan)[:, None] * directions)


def triangulate(origins: Array, directions: Array, poses: Array) -> tuple[Array, Array]:
    """Return the point that has the least squared angles to K rays. Each ray is in its own camera
    frame, and (K, 6) T_camera_board relates these frames.

    Returns:
        The point, (3,) m in the board's frame, and the angle between the point and each ray, (K,)
        rad; NaN if the rays are parallel, or meet behind a camera.
    """
    to_board = turns(poses).swapaxes(1, 2)  # (K, 3, 3) T_board_camera
    start = (to_board @ (origins - poses[:, 3:])[..., None])[..., 0]
    unit = (
        to_board @ (directions / np.linalg.norm(directions, axis=-1, keepdims=True))[..., None]
    )[..., 0]
    projectors = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    nowhere = np.full(3, np.nan), np.full(len(start), np.nan)
    lengths = np.ones(len(start))
    for _ in range(WEIGHTINGS):
        weighted = projectors / (lengths**2)[:, None, None]
        system = weighted.sum(0)
        if not np.isfinite(system).all() or np.linalg.cond(system) > PARALLEL:
            return nowhere
        point = np.linalg.solve(system, (weighted @ start[..., None]).sum(0)[:, 0])
        lengths = np.linalg.norm(point - start, axis=-1)
    if (((point - start) * unit).sum(-1) <= 0).any():
        return nowhere
    return point, np.linalg.norm(
        (projectors @ (point - start)[..., None])[..., 0], axis=-1
    ) / lengths


def central_differences(
    function: Callable[[Array], Array], at: Array, steps: Sequence[float]
) -> Array:
    """Return the (N, m, k) central differences of a function from (N, k) to (N, m) that treats
    every row separately.
    """
    columns = [
        (function(at + step) - function(at - step)) / (2 * size)
        for step, size in zip(np.diag(steps), steps, strict=True)
    ]
    return np.stack(columns, -1)
