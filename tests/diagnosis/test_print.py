"""A print that OpenCV shows longer one way, sheared, or drawn out unevenly: it is found, and has
the terms that it needs, not more.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import View
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.progress import Silent
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from tests.effects.rays import camera_matrix


def diagnosed(points: NDArray[np.float64]) -> tuple[Calibration, Diagnosis]:
    """Diagnose fifteen views of a board whose corners are printed at (K, 2) m, with 0.1 px of
    noise.
    """
    made = scene(3, views=15)
    rng = np.random.default_rng(1)
    solid = np.column_stack([points, np.zeros(made.board.count)])
    matrix = camera_matrix()
    projected = [
        cv2.projectPoints(solid, pose[:3], pose[3:], matrix, np.zeros(4))[0].reshape(-1, 2)
        for pose in made.poses.numpy()
    ]
    views = tuple(
        View(f"{i}.png", pixels + rng.normal(0, 0.1, pixels.shape), np.ones(made.board.count))
        for i, pixels in enumerate(projected)
    )
    estimate = lens_alone(made, 3280, 2464, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return diagnose(replace(estimate, views=views, poses=made.poses.numpy()), Silent())


def compare(calibration: Calibration, truth: dict[str, float]) -> None:
    numbers = {
        name: number for effect in calibration.effects for name, number in effect.parameters.items()
    }
    for name, (value, sigma) in numbers.items():
        assert value == pytest.approx(truth.get(name, 0.0), abs=4 * sigma), name
        assert sigma < 5e-4


@pytest.mark.parametrize(
    ("stretch", "shear"),
    [
        (0.0, 4e-3),
        (4e-3, 0.0),
        (-3e-3, 3e-3),
    ],
)
@pytest.mark.slow
def test_the_evidence_decides_whether_a_print_is_sheared(stretch: float, shear: float) -> None:
    points = scene(3, views=15).board.points() @ [
        [1 + stretch / 2, shear / 2],
        [shear / 2, 1 - stretch / 2],
    ]
    estimate, finding = diagnosed(points)
    assert finding.accepted == ("board_scale",)
    (added,) = estimate.effects
    assert set(added.parameters) == {"board_scale.x_over_y"} | (
        {"board_scale.shear"} if shear else set()
    )
    compare(estimate, {"board_scale.x_over_y": stretch, "board_scale.shear": shear})


@pytest.mark.slow
def test_a_print_stretched_increasingly_down_the_sheet_has_its_terms() -> None:
    """Rows grow longer by 0.3 % from the middle to the last, and lie a tenth of a millimetre too
    low there.
    """
    board = scene(3, views=15).board
    points = board.points()
    u, v = (points / board.half).T
    points = points + np.column_stack([2.4e-4 * u * v, 1e-4 * (3 * v**2 - 1) / 2])
    estimate, finding = diagnosed(points)
    assert finding.accepted == ("board_scale",)
    (added,) = estimate.effects
    assert len(added.parameters) == 2 + 6
    compare(estimate, {"board_scale.x.xy": 2.4e-4, "board_scale.y.yy": 1e-4})
    assert (
        max(float(sigma) for name, (_, sigma) in added.parameters.items() if name.count(".") == 2)
        < 1e-5
    )
