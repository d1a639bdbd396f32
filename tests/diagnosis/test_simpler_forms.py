"""The parameters that an effect no longer needs are dropped, and the others stay."""

import pytest
import torch

from calib.diagnosis.simpler_forms import simplified
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.inference.calibration_model import base_model, full_model
from calib.inference.fitted_model import ModelFit
from tests.diagnosis.hide import without_cover


@pytest.mark.parametrize("third", [0.0, 1e-4])
def test_effects_end_in_the_simplest_form_that_the_corners_support(third: float) -> None:
    """A print and a board of more terms than they have, but for those of degree 3 of the one board
    that has such a term.
    """
    hidden = BoardShape(0.08, 0.08, 3)
    sizes = {unknown.param.name: 0.0 for unknown in hidden.effect_parameters} | {
        "board_shape.xx": 5e-4,
        "board_shape.xxy": third,
    }
    calibration = without_cover(hidden, sizes, 0.1)
    observations, base = calibration.observations, base_model(calibration)
    start = full_model(calibration).fit(observations, torch.from_numpy(calibration.poses))
    largest = base.with_effects([BoardScale(True, 3, (0.08, 0.08)), BoardShape(0.08, 0.08, 4)])
    joint = largest.fit(observations, start.poses, start.start, (1e-3, 1e-4))
    estimate = simplified(ModelFit(largest, joint), base, observations)
    assert estimate.model.effects == (
        BoardScale(half=(0.08, 0.08)),
        BoardShape(0.08, 0.08, 3 if third else 2),
    )
    assert estimate.joint.log_marginal > joint.log_marginal
    second_run = simplified(estimate, base, observations)
    assert second_run.model is estimate.model
