"""Select the views whose board pose can be initialised from their corners through the pinhole."""

from collections.abc import Sequence

import torch
from torch import Tensor

from calib.corners.view import RejectedPicture, View
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.optics.params import Values
from calib.session.board import Board


def with_initial_pose(
    views: Sequence[View], board: Board, values: Values
) -> tuple[tuple[View, ...], Tensor, tuple[RejectedPicture, ...]]:
    """Return the views with an initial pose, these (V, 6) poses through the pinhole of `values`,
    and the rejected views with the reason.
    """
    poses = pinhole_poses(Observations.of(views, board), values)
    has_pose = torch.isfinite(poses).all(-1)
    rejected = tuple(
        RejectedPicture(view.name, "no board pose explains its corners")
        for view, usable in zip(views, has_pose, strict=True)
        if not usable
    )
    return (
        tuple(view for view, usable in zip(views, has_pose, strict=True) if usable),
        poses[has_pose],
        rejected,
    )
