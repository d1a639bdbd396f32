"""Where the boards are: the pose of each, its motion while it is read out, and its own bend."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.exposure import Exposure
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector
from calib.optics.view_blocks import FLEX, MOTION, block_columns, blocks_of_size


@dataclass(frozen=True, slots=True)
class Placement:
    """The poses of boards: T_camera_board as a rotation and a translation."""

    turn: Tensor
    """(..., 3, 3)"""
    shift: Tensor
    """(..., 3) m"""
    motion: Tensor | None = None
    """(..., 6): the rotation (rotation vector in the camera frame, rad) and translation (m) of the
    board during the readout of its picture.
    """

    flex: Tensor | None = None
    """(..., FLEX_TERMS) m: the bend of the board in this view alone."""

    @staticmethod
    def of(parameters: Tensor) -> Placement:
        """Return the placements of (..., B) view parameters: rotation vector (rad), translation
        (m), then the optional blocks in the order of VIEW_BLOCKS.
        """
        columns = block_columns(blocks_of_size(parameters.shape[-1]))
        motion = parameters[..., columns[MOTION]] if MOTION in columns else None
        flex = parameters[..., columns[FLEX]] if FLEX in columns else None
        return Placement(rotation.matrix(parameters[..., :3]), parameters[..., 3:6], motion, flex)

    def __getitem__(self, rows: Tensor) -> Placement:
        motion = None if self.motion is None else self.motion[rows]
        flex = None if self.flex is None else self.flex[rows]
        return Placement(self.turn[rows], self.shift[rows], motion, flex)

    def at_exposure(self, exposure: Exposure | None) -> Placement:
        """Return the placements at the time when the line of each ray is read."""
        if self.motion is None or exposure is None:
            return self
        motion = self.motion * exposure.line.unsqueeze(-1)
        return Placement(
            rotation.matrix(motion[..., :3]) @ self.turn,
            self.shift + motion[..., 3:],
            flex=self.flex,
        )

    def planes(self, points: Tensor, *, is_wide: bool) -> Placement:
        """Return the placements of planes that face the camera, one through each of (..., 3) m
        points of the boards, which is its origin. The planes of a wide lens face along the line
        from the camera to the point, those of other lenses along the camera's axis.
        """
        placed = Rotation.of(self.turn).turn(Vector.of(points)).stacked() + self.shift
        turn = torch.eye(3).to(placed).expand(*placed.shape, 3)
        if is_wide:
            turn = rotation.onto_z(placed.detach() / placed.detach().norm(dim=-1, keepdim=True)).mT
        return Placement(turn, placed)


@dataclass(frozen=True, slots=True)
class ByPlacement:
    """The derivatives of k outputs of M rays by the placement of each ray's board."""

    turn: Vector
    """(k, M) by a further small rotation, rad, along the axes of the camera frame."""
    shift: Vector
    """(k, M) per m"""
    flex: Tensor | None
    """(k, M, FLEX_TERMS) per m, if the board bends differently in every view."""

    def of_board(self, planes: Placement, boards: Placement) -> ByPlacement:
        """Return the derivatives by the placement of boards, from those by that of the planes
        through their points (`Path.planes`): a turn of the board moves the points alone.
        """
        if planes is boards:
            return self
        return replace(self, turn=Vector.of(planes.shift - boards.shift).cross(self.shift))
