"""A print that OpenCV shows longer one way, sheared, or both: it is found, and only a print that is sheared gets a shear."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.corners.view import View
from calib.diagnosis.diagnose import diagnose
from calib.progress import Silent
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from tests.effects.rays import camera_matrix


@pytest.mark.parametrize(("stretch", "shear"), [(0.0, 4e-3), (4e-3, 0.0), (-3e-3, 3e-3)])
def test_whether_a_print_is_sheared_the_evidence_chooses(stretch: float, shear: float) -> None:
    made = scene(3, views=15)
    points = made.board.points() @ [[1 + stretch / 2, shear / 2], [shear / 2, 1 - stretch / 2]]
    rng = np.random.default_rng(1)
    solid = np.column_stack([points, np.zeros(made.board.count)])
    matrix = camera_matrix()
    seen = [cv2.projectPoints(solid, pose[:3], pose[3:], matrix, np.zeros(4))[0].reshape(-1, 2) for pose in made.poses.numpy()]
    views = tuple(View(f"{i}.png", pixels + rng.normal(0, 0.1, pixels.shape), np.ones(made.board.count)) for i, pixels in enumerate(seen))
    known = lens_alone(made, 3280, 2464, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    found, finding = diagnose(replace(known, views=views, poses=made.poses.numpy()), Silent())
    assert finding.accepted == ("board_scale",)
    numbers = {name: number for one in found.effects for name, number in one.parameters.items()}
    assert ("board_scale.shear" in numbers) == (shear != 0)
    truth = {"board_scale.x_over_y": stretch, "board_scale.shear": shear}
    for name, (value, sigma) in numbers.items():
        assert value == pytest.approx(truth[name], abs=4 * sigma)
        assert sigma < 5e-4
