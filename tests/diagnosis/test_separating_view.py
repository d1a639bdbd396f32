"""The view that tells effects apart, against what such a view does when it is taken."""

import numpy as np
import pytest
import torch

from calib.calibration import Calibration
from calib.corners.view import View
from calib.diagnosis.nearest_effects import nearest_named
from calib.diagnosis.separating_view import separating_view
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.detector_bias import DetectorBias
from calib.effects.focal import Focal
from calib.effects.free_field import FreeField
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.inference.calibration_model import base_model
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.session.camera import Camera
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.diagnosis.hide import fitted, hidden

CAMERA = Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return fitted(hidden(None, {}, views=10))


def optimum(model: CameraModel, observations: Observations, poses: np.ndarray) -> FittedModel:
    return FittedModel(model, observations, model.fit(observations, torch.from_numpy(poses)))


def test_the_proposed_view_reduces_the_sigma_as_predicted(calibration: Calibration) -> None:
    """The view is added, and all views are fitted again with both effects free."""
    stretch, focal = BoardScale(), Focal()
    model = base_model(calibration).with_effect(stretch)
    at = optimum(model, calibration.observations, calibration.poses)
    view = separating_view(at, calibration.board, CAMERA, stretch, (focal,))
    assert view
    points = at.model.path.place(
        torch.from_numpy(calibration.board.points()),
        at.joint.values,
        torch.from_numpy(view.pose),
        MIDDLE,
    )
    corners = project(at.model.path, at.joint.values, points, MIDDLE)
    assert np.allclose(corners.numpy(), view.corners)
    wider = model.with_effect(focal)
    added_view = View("more", view.corners, np.ones(calibration.board.count))
    taken = (
        (calibration.views, calibration.poses),
        (
            (*calibration.views, added_view),
            np.vstack([calibration.poses, view.pose]),
        ),
    )
    sigmas = []
    for views, poses in taken:
        refitted = optimum(wider, Observations.of(views, calibration.board), poses).joint
        sigmas.append(float(refitted.sigma_of("board_scale.x_over_y") / refitted.sigma))
    assert view.sigma_factor > 1.05
    assert sigmas[0] / sigmas[1] == pytest.approx(
        view.sigma_factor, rel=0.1
    )  # noise, prior and weights are estimated anew


@pytest.mark.slow
def test_the_true_effect_is_named_as_nearest_to_a_field() -> None:
    """The hidden effect is a stretched print. A field over the board imitates it, a bow cannot."""
    made = fitted(hidden(BoardScale(), {"board_scale.x_over_y": 2e-2}))
    at = optimum(base_model(made), made.observations, made.poses)
    (field,) = FreeField.propose(effect_context(at, made.board, CAMERA, locate=False))
    values = at.model.with_effect(field).fit(made.observations, at.joint.poses).values
    near = nearest_named(at, field, values, (BoardShape(0.08, 0.08), DetectorBias(), BoardScale()))
    assert near[0][0] == "board_scale"
    assert 0.5 < near[0][1] <= 1.0
    assert "detector_bias" not in dict(near)
