"""The composition of poses, and its derivatives.

A pose is T_to_from as (6,) numbers, a rotation vector (rad) and a translation (m). A camera's
mounting is T_camera_reference, a board's placement T_reference_board, and the board's pose in the
camera is their product, T_camera_board.

The numbers of a placement may go on behind its pose, with the bend of its board
(`calib.optics.view_blocks.VIEW_BLOCKS`). A bend is in the board's frame, so every camera sees the
same one.

Source: T. D. Barfoot, State estimation for robotics (2017), section 7.1.5, for the left Jacobian of
SO(3) and its inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.optics import rotation

SMALL_ANGLE = 1e-6
"""rad: below this, a rotation vector is half the antisymmetric part of its matrix."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ComposedPoses:
    """The (V, 6) poses of boards in a camera, and their derivatives."""

    poses: Tensor
    """(V, B) T_camera_board, and the bend of the board if there is one."""
    by_mounting: Tensor
    """(V, B, 6) derivatives by the camera's mounting."""
    by_placement: Tensor
    """(V, B, B) derivatives by the board's placement."""


def compose(mounting: Tensor, placements: Tensor) -> Tensor:
    """Return the (..., B) poses T_camera_board of (..., B) placements T_reference_board, for a
    (..., 6) mounting T_camera_reference. A bend of the board stays as it is.
    """
    turn = rotation.matrix(mounting[..., :3])
    turns = turn @ rotation.matrix(placements[..., :3])
    shifts = (turn @ placements[..., 3:6].unsqueeze(-1)).squeeze(-1) + mounting[..., 3:]
    bends = placements[..., 6:].expand(*shifts.shape[:-1], -1)
    return torch.cat([rotation_vector(turns), shifts, bends], -1)


def compose_with_derivatives(mounting: Tensor, placements: Tensor) -> ComposedPoses:
    """Return the poses of (V, B) placements T_reference_board in a camera of a (6,) mounting
    T_camera_reference, or of a (V, 6) mounting in each view, and their derivatives.
    """
    poses = compose(mounting, placements)
    turn = rotation.matrix(mounting[..., :3])
    to_vector = torch.linalg.inv(rotation.left_jacobian(poses[:, :3]))  # (V, 3, 3)
    turn_by_mounting = rotation.left_jacobian(mounting[..., :3])
    arm = (turn @ placements[:, 3:6].unsqueeze(-1)).squeeze(-1)  # (V, 3) m, in the camera frame
    count, size = poses.shape
    by_mounting = poses.new_zeros(count, size, 6)
    by_mounting[:, :3, :3] = to_vector @ turn_by_mounting
    by_mounting[:, 3:6, :3] = -cross_matrix(arm) @ turn_by_mounting
    by_mounting[:, 3:6, 3:] = torch.eye(3).to(poses)
    by_placement = torch.eye(size).to(poses).repeat(count, 1, 1)
    by_placement[:, :3, :3] = to_vector @ turn @ rotation.left_jacobian(placements[:, :3])
    by_placement[:, 3:6, 3:6] = turn
    return ComposedPoses(poses, by_mounting, by_placement)


def invert_poses(poses: Tensor) -> Tensor:
    """Return the (..., 6) inverses of (..., 6) poses."""
    turn = rotation.matrix(poses[..., :3]).mT
    shift = -(turn @ poses[..., 3:].unsqueeze(-1)).squeeze(-1)
    return torch.cat([-poses[..., :3], shift], -1)


def pose_matrix(pose: Tensor) -> Array:
    """Return the (4, 4) matrix of a (6,) pose."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.matrix(pose[:3]).numpy()
    matrix[:3, 3] = pose[3:].numpy()
    return matrix


def move_points(pose: Tensor, points: Tensor) -> Tensor:
    """Return (N, 3) m points in the frame to which a (6,) pose leads."""
    return points @ rotation.matrix(pose[:3]).mT + pose[3:]


def rotation_vector(turns: Tensor) -> Tensor:
    """Return the (..., 3) rotation vectors, rad, of (..., 3, 3) rotation matrices, at most pi long.

    They come from unit quaternions, whose largest component is computed first, so that they are
    exact at half a turn as well.
    """
    diagonal = turns.diagonal(dim1=-2, dim2=-1)
    trace = diagonal.sum(-1, keepdim=True)
    # Four times the outer product of the quaternion (w, x, y, z) with itself.
    squares = torch.cat([trace + 1, 2 * diagonal - trace + 1], -1)
    skew = torch.stack(
        [
            turns[..., 2, 1] - turns[..., 1, 2],
            turns[..., 0, 2] - turns[..., 2, 0],
            turns[..., 1, 0] - turns[..., 0, 1],
        ],
        -1,
    )
    symmetric = turns + turns.mT
    outer = turns.new_zeros(*turns.shape[:-2], 4, 4)
    outer[..., 0, 1:] = skew
    outer[..., 1:, 0] = skew
    outer[..., 1:, 1:] = symmetric
    outer.diagonal(dim1=-2, dim2=-1).copy_(squares)
    largest = squares.argmax(-1)[..., None, None].expand(*squares.shape[:-1], 1, 4)
    quaternion = outer.gather(-2, largest).squeeze(-2)
    quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
    sign = torch.where(quaternion[..., :1] < 0, -1.0, 1.0)
    scalar = quaternion[..., :1] * sign
    vector = quaternion[..., 1:] * sign
    sine = vector.norm(dim=-1, keepdim=True)  # of half the angle
    small = sine < SMALL_ANGLE
    safe = torch.where(small, torch.ones_like(sine), sine)
    vectors: Tensor = vector * torch.where(small, 2 / scalar, 2 * torch.atan2(sine, scalar) / safe)
    return vectors


def cross_matrix(vectors: Tensor) -> Tensor:
    """Return the (..., 3, 3) matrices [v] with [v] w = v x w, of (..., 3) vectors."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    rows = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1)
    return rows.reshape(*vectors.shape[:-1], 3, 3)
