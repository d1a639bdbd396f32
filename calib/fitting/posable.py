"""The views of which there is a pose of the board to begin with: one that corners explain through
the pinhole, if not well.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from calib.corners.view import RejectedPicture, View
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.optics.params import Values
from calib.session.board import Board


def posable(
    views: Sequence[View], board: Board, values: Values
) -> tuple[tuple[View, ...], Tensor, tuple[RejectedPicture, ...]]:
    """Those views, their (V, 6) poses through the pinhole of `values`, and the others with the
    reason.
    """
    poses = pinhole_poses(Observations.of(views, board), values)
    found = torch.isfinite(poses).all(-1)
    lost = tuple(
        RejectedPicture(view.name, "no board pose explains its corners")
        for view, ok in zip(views, found, strict=True)
        if not ok
    )
    return tuple(view for view, ok in zip(views, found, strict=True) if ok), poses[found], lost
