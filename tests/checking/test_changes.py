"""The two changes that no diagnosis proposes: a cover turned about its own axis, and pictures of
another mode.
"""

import numpy as np
import pytest
import torch

from calib.checking.changes import KINDS, changes_of
from calib.checking.cover_spin import CoverSpin
from calib.checking.picture_mode import PictureMode
from calib.optics.exposure import MIDDLE
from fixtures.synthetic import HEIGHT, WIDTH, scene
from tests.checking.conftest import Made

PIXELS = torch.tensor([[400.0, 300.0], [1700.0, 1200.0], [3000.0, 2300.0]], dtype=torch.float64)


def test_neutral_changes_nothing(cameras: Made) -> None:
    for _, checker in cameras.values():
        path, values = checker.calibration.model()
        initial = path.trace(PIXELS, values, MIDDLE)
        for change in checker.changes:
            neutral = {
                u.param.name: torch.full(u.param.shape, u.neutral, dtype=torch.float64)
                for u in change.effect_parameters
            }
            final = change.apply(path).trace(PIXELS, {**values, **neutral}, MIDDLE)
            for expected_part, changed_part in (
                (initial.origin, final.origin),
                (initial.direction, final.direction),
            ):
                assert (expected_part.stacked() - changed_part.stacked()).abs().max() < 1e-12, (
                    change.name
                )


def test_every_kind_of_change_is_possible_for_some_camera(cameras: Made) -> None:
    names = {
        change.name for _, checker in cameras.values() for change in changes_of(checker.calibration)
    }
    assert names == {kind.name for kind in KINDS}


def test_a_spun_cone_carries_its_bumps_along() -> None:
    """Oracle built without the change: the camera is turned about the cone's axis instead, with its
    pinhole on that axis.
    """
    made = scene(1, 1)
    values = {
        **made.values,
        "cover.axis_offset.z": torch.tensor(0.0, dtype=torch.float64),
        "cover.axis_offset.x": torch.tensor(0.0, dtype=torch.float64),
    }
    angle = torch.tensor(0.05, dtype=torch.float64)
    spun = (
        CoverSpin("y")
        .apply(made.path)
        .trace(PIXELS[1:2], {**values, "cover_spin.y": angle}, MIDDLE)
    )
    cos, sin = float(angle.cos()), float(angle.sin())
    turn = torch.tensor(
        [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], dtype=torch.float64
    )  # T_camera_cover
    start = made.path.lens(PIXELS[1:2], values).direction.stacked() @ turn  # seen from the cover
    f = torch.stack([values["camera.fx"], values["camera.fy"]])
    c = torch.stack([values["camera.cx"], values["camera.cy"]])
    pixel = f * start[:, :2] / start[:, 2:] + c
    unspun = made.path.trace(pixel, values, MIDDLE)
    assert (spun.direction.stacked() - unspun.direction.stacked() @ turn.T).abs().max() < 1e-12
    assert (spun.origin.stacked() - unspun.origin.stacked() @ turn.T).abs().max() < 1e-12


def test_a_zoomed_pixel_is_the_one_of_the_middle() -> None:
    mode = PictureMode(WIDTH, HEIGHT)
    values = {
        "picture_mode.log_scale": torch.tensor(np.log(0.5)),
        "picture_mode.shift.x": torch.tensor(3.0, dtype=torch.float64),
        "picture_mode.shift.y": torch.tensor(-4.0, dtype=torch.float64),
    }
    middle = torch.tensor([[(WIDTH - 1) / 2, (HEIGHT - 1) / 2]], dtype=torch.float64)
    moved, _ = mode(middle + torch.tensor([[100.0, 200.0]]), values, MIDDLE)
    assert moved[0].tolist() == pytest.approx((middle[0] + torch.tensor([53.0, 96.0])).tolist())
