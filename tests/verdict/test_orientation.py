"""Turned and mirrored pictures, told from wrong numbers."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.session.schema import Number
from calib.verdict.judge import judge
from calib.verdict.orientation import ALL, Orientation
from fixtures.calibrated import CAMERA, tolerant
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, scene

FAST = Settings(grid=(4, 4))
TURNS = {0: None, 1: cv2.ROTATE_90_CLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_COUNTERCLOCKWISE}


@pytest.mark.parametrize("orientation", ALL, ids=str)
def test_a_turned_pixel_agrees_with_opencv(orientation: Orientation) -> None:
    picture = np.arange(12 * 8, dtype=np.int32).reshape(8, 12)
    turn = TURNS[orientation.quarters]
    put_right = picture if turn is None else cv2.rotate(picture, turn)
    put_right = cv2.flip(put_right, 1) if orientation.mirrored else put_right
    y, x = np.mgrid[0:8, 0:12]
    pixels = torch.from_numpy(np.stack([x.ravel(), y.ravel()], -1).astype(np.float64))
    observations = Observations.of(
        (View("a", pixels[:81].numpy(), np.ones(81)),), scene(1, views=1).board
    )
    moved = orientation.apply(observations, 12, 8).pixels.numpy().astype(int)
    assert (put_right[moved[:, 1], moved[:, 0]] == picture.ravel()[:81]).all()


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(3, views=12, noise=0.02)


def turned(made: Scene, quarters: int, mirrored: bool) -> tuple[View, ...]:
    """The views in pictures that the driver turned half around or mirrored, with corners in a
    detector's order.
    """
    views = []
    for view in made.views:
        x, y = view.corners.T
        x, y = (WIDTH - 1 - x, HEIGHT - 1 - y) if quarters == 2 else (x, y)
        corners = np.stack([WIDTH - 1 - x if mirrored else x, y], -1)
        views.append(
            replace(
                view,
                corners=corners.reshape(9, 9, 2)[:, ::-1].reshape(-1, 2) if mirrored else corners,
            )
        )
    return tuple(views)


@pytest.mark.parametrize(
    ("quarters", "mirrored"), [pytest.param(2, False, marks=pytest.mark.slow), (0, True), (2, True)]
)
def test_turned_and_mirrored_pictures_are_named(made: Scene, quarters: int, mirrored: bool) -> None:
    verdict = judge(
        tolerant(
            replace(made, views=turned(made, quarters, mirrored)),
            Setup(made.board, CAMERA, INTRINSICS, made.cover),
            FAST,
        )
    )
    reasons = [reason for reason in verdict.reasons if "frames" in reason.suspects]
    (reason,) = reasons
    assert str(Orientation(quarters, mirrored)) in reason.sentence


def test_a_wrong_thickness_is_no_orientation(made: Scene) -> None:
    wrong = replace(made.cover, parameters={**made.cover.parameters, "thickness": Number(0.006)})
    verdict = judge(tolerant(made, Setup(made.board, CAMERA, INTRINSICS, wrong), FAST))
    assert "frames" not in verdict.suspects
