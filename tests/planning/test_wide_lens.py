"""Poses before a camera with a fisheye lens."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.planning.pose_bank import Reach, fit_bare_pose, make_pose_bank, mask_to_picture
from calib.session.board import Board
from fixtures.wide import BOARD, CAMERA, INTRINSICS

CAMERA_WIDE = replace(CAMERA, intrinsics=INTRINSICS)


@pytest.mark.parametrize("focal", [300.0, 150.0])
def test_its_poses_are_in_the_picture_where_the_ray_path_has_them(focal: float) -> None:
    """One lens sees 170 degrees across the diagonal, another one more than 180 degrees from side to
    side.
    """
    lens = replace(
        INTRINSICS, fx=replace(INTRINSICS.fx, value=focal), fy=replace(INTRINSICS.fy, value=focal)
    )
    camera = replace(CAMERA, intrinsics=lens)
    bank = make_pose_bank(BOARD, camera, Reach.of(BOARD, camera))
    assert len(bank.poses) > 50
    path, values = pinhole_path(lens)
    for pose, corners in zip(bank.poses[::10], bank.corners[::10], strict=True):
        placed = path.place(
            torch.from_numpy(BOARD.points()), values, torch.from_numpy(pose), MIDDLE
        )
        assert np.abs(path.lens.project(placed, values).numpy() - corners).max() < 1e-9
    assert np.isfinite(mask_to_picture(bank.corners, camera)).all()
    around = np.ptp(bank.corners.reshape(-1, 2), axis=0) / [camera.width, camera.height]
    assert (around > (0.7 if focal == 300 else 0.4)).all(), (
        "of the picture; the wider lens sees a board at its side too flat"
    )


def test_a_pose_is_recovered_from_visible_corners() -> None:
    bank = make_pose_bank(BOARD, CAMERA_WIDE, Reach.of(BOARD, CAMERA_WIDE))
    for pose, corners in zip(bank.poses[::10], bank.corners[::10], strict=True):
        refitted = fit_bare_pose(
            Board(BOARD.columns, BOARD.rows, BOARD.square), CAMERA_WIDE, corners
        )
        assert refitted is not None
        assert np.abs(refitted - pose).max() < 1e-6
