"""Select the views whose board pose can be initialised from their corners through the pinhole."""

from collections.abc import Sequence

import torch
from torch import Tensor

from calib.corners.view import RejectedPicture, View
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.board import Board


def with_initial_pose(
    path: Path, values: Values, views: Sequence[View], board: Board
) -> tuple[tuple[View, ...], Tensor, tuple[RejectedPicture, ...]]:
    """Return the views with an initial pose, these (V, 6) poses through the lens of the path,
    and the rejected views with the reason.
    """
    poses = pinhole_poses(path, values, Observations.of(views, board))
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
