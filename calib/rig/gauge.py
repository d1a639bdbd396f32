"""The rigid motion of all rays of a rig that views of a board at unknown placements do not
determine. No standard deviation counts it.

Of each error, the motion that hides most of it at the training corners is subtracted, as
`calib.apply.map_uncertainty` does for one camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.apply.map_uncertainty import frames_along
from calib.estimation.jacobians import undistorted_jacobian
from calib.optics.rotation import left_jacobian, matrix
from calib.rig.poses import cross_matrix
from calib.rig.triangulation import PlacedCamera

Array = NDArray[np.float64]


def gauge_motion(
    cameras: Sequence[PlacedCamera], pixels: Sequence[Array], points: Sequence[Array], count: int
) -> Array:
    """Return the (6, S) motion of all rays, a rotation (rad) and a translation (m) in the
    reference's frame, that hides most of a change of each number of the rig.

    Args:
        cameras: C cameras.
        pixels: for each camera, the (M, 2) px of its training corners.
        points: for each camera, their (M, 3) m places in the camera's frame.
        count: S, the length of the rig's vector.
    """
    normal, right_side = np.zeros((6, 6)), np.zeros((6, count))
    for camera, corners, places in zip(cameras, pixels, points, strict=True):
        by_numbers, by_motion = _corner_errors(camera, corners, places)
        to_camera = _motion_in_camera(camera.mounting).numpy()
        by_gauge = by_motion @ to_camera
        normal += by_gauge.T @ by_gauge
        right_side[:, camera.columns] += by_gauge.T @ by_numbers
        if len(camera.mounting_columns):
            by_mounting = -by_motion @ mounting_motion(camera.mounting)
            right_side[:, camera.mounting_columns] += by_gauge.T @ by_mounting
    return np.asarray(np.linalg.solve(normal, right_side))


def ray_motion(camera: PlacedCamera, pixels: Array, points: Array, count: int) -> Array:
    """Return the (6, S) motion of one camera's rays in its own frame that hides most of a change of
    each of its own numbers; zero for other numbers. The arguments are those of `gauge_motion`.
    """
    motion = np.zeros((6, count))
    by_numbers, by_motion = _corner_errors(camera, pixels, points)
    motion[:, camera.columns] = np.linalg.solve(by_motion.T @ by_motion, by_motion.T @ by_numbers)
    return motion


def mounting_motion(mounting: Tensor) -> Array:
    """Return the (6, 6) small motion in the camera's frame, a rotation (rad) and a translation (m),
    by which a change of the (6,) mounting moves everything outside.
    """
    turn = left_jacobian(mounting[:3])
    by_mounting = torch.zeros(6, 6, dtype=torch.float64)
    by_mounting[:3, :3] = turn
    by_mounting[3:, :3] = cross_matrix(mounting[3:]) @ turn
    by_mounting[3:, 3:] = torch.eye(3)
    return by_mounting.numpy()


def point_motion(points: Array) -> Array:
    """Return the (N, 3, 6) derivatives of (N, 3) m points by a small rotation and translation."""
    rows = torch.from_numpy(points)
    eye = torch.eye(3, dtype=torch.float64).expand(len(points), 3, 3)
    return torch.cat([-cross_matrix(rows), eye], -1).numpy()


def _motion_in_camera(mounting: Tensor) -> Tensor:
    """Return the (6, 6) matrix from a small motion in the reference's frame to that in the frame of
    a camera with this (6,) mounting.
    """
    turn = matrix(mounting[:3])
    to_camera = torch.zeros(6, 6, dtype=torch.float64)
    to_camera[:3, :3] = turn
    to_camera[3:, :3] = cross_matrix(mounting[3:]) @ turn
    to_camera[3:, 3:] = turn
    return to_camera


def _corner_errors(camera: PlacedCamera, pixels: Array, points: Array) -> tuple[Array, Array]:
    """Return the changes, px, of the undistorted places of (M, 2) px corners at (M, 3) m points:
    (2 M, S_c) by the camera's parameters, and (2 M, 6) by a small motion of all its rays. Corners
    without a ray do not change.
    """
    frames = None
    in_frame = points
    if camera.path.lens.wide:
        frames = frames_along(points / np.linalg.norm(points, axis=-1, keepdims=True))
        in_frame = np.einsum("nij,nj->ni", frames, points)
    jacobian, motions, invalid = undistorted_jacobian(
        camera.path, camera.parameters, pixels, frames
    )
    used = ~invalid & (in_frame[:, 2] > 0)
    near = 1 / np.where(used, in_frame[:, 2], 1.0)[:, None, None]
    visible = used[:, None, None]
    by_numbers = np.where(visible, jacobian[:, 0] + near * jacobian[:, 1], 0.0)
    by_motion = np.where(visible, motions[:, 0] + near * motions[:, 1], 0.0)
    rows = 2 * len(points)
    return by_numbers.reshape(rows, jacobian.shape[-1]), by_motion.reshape(rows, 6)
