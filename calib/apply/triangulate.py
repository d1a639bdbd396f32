"""Where rays intersect a plane, the point that several rays come nearest to, and derivatives by
central differences.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from calib.optics import rotation
from calib.undistortion.grids import Array

WEIGHTINGS = 3
"""How often a point's rays are weighted by their length, which the point itself gives."""
PARALLEL = 1e12
"""The condition number from which rays count as parallel."""


def turns(poses: Array) -> Array:
    """(N, 3, 3) rotations of (N, 6) poses."""
    return rotation.matrix(torch.from_numpy(np.ascontiguousarray(poses[:, :3]))).numpy()


def intersect(origins: Array, directions: Array, poses: Array) -> Array:
    """(N, 3) m where rays intersect the x-y planes of (N, 6) poses; NaN where they do not."""
    normals = turns(poses)[:, :, 2]
    towards = (directions * normals).sum(-1)
    along = ((poses[:, 3:] - origins) * normals).sum(-1) / np.where(
        np.abs(towards) < 1e-9, np.nan, towards
    )
    return np.asarray(origins + np.where(along > 0, along, np.nan)[:, None] * directions)


def triangulate(origins: Array, directions: Array, poses: Array) -> tuple[Array, Array]:
    """The point that K rays, each in the camera frame of its own (K, 6) T_camera_board, miss least
    in angle.

    Returns:
        (3,) m in the board's frame and (K,) rad by how much each misses it; NaN where the rays are
        parallel, or meet behind a camera.
    """
    turned = turns(poses).swapaxes(1, 2)  # (K, 3, 3) T_board_camera
    start = (turned @ (origins - poses[:, 3:])[..., None])[..., 0]
    along = (turned @ (directions / np.linalg.norm(directions, axis=-1, keepdims=True))[..., None])[
        ..., 0
    ]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    nowhere = np.full(3, np.nan), np.full(len(start), np.nan)
    lengths = np.ones(len(start))
    for _ in range(WEIGHTINGS):
        weighted = across / (lengths**2)[:, None, None]
        system = weighted.sum(0)
        if not np.isfinite(system).all() or np.linalg.cond(system) > PARALLEL:
            return nowhere
        point = np.linalg.solve(system, (weighted @ start[..., None]).sum(0)[:, 0])
        lengths = np.linalg.norm(point - start, axis=-1)
    if (((point - start) * along).sum(-1) <= 0).any():
        return nowhere
    return point, np.linalg.norm((across @ (point - start)[..., None])[..., 0], axis=-1) / lengths


def central_differences(
    function: Callable[[Array], Array], at: Array, steps: Sequence[float]
) -> Array:
    """(N, m, k) central differences of a function from (N, k) to (N, m) that treats every row by
    itself.
    """
    columns = [
        (function(at + step) - function(at - step)) / (2 * size)
        for step, size in zip(np.diag(steps), steps, strict=True)
    ]
    return np.stack(columns, -1)
