"""The difference of two fits."""

from dataclasses import replace

import pytest
import torch

from calib.diagnosis.equivalence import _odds
from calib.effects.rolling_shutter import RollingShutter
from calib.inference.calibration_model import full_model
from calib.inference.fitted_model import ModelFit
from calib.inference.vuong import prior_difference
from calib.threads import single_thread
from tests.diagnosis.hide import fitted, hidden


def test_smaller_motions_of_the_views_do_not_decide() -> None:
    """Two fits with the same residuals are as probable, if one has smaller motions and a larger
    evidence by the prior of these.
    """
    calibration = fitted(hidden(None, {}, 1, 10))
    model, observations = full_model(calibration), calibration.observations
    model = model.with_effect(RollingShutter())
    poses = torch.from_numpy(calibration.poses)
    with single_thread():
        joint = model.fit(observations, model.pad_poses(poses))
    larger = joint.poses.clone()
    larger[:, 6:] *= 2.0
    fit = ModelFit(model, joint)
    worse = ModelFit(model, replace(joint, poses=larger))
    difference = prior_difference(fit, worse)
    assert difference > 0
    assert prior_difference(worse, fit) == pytest.approx(-difference)
    worse = ModelFit(
        model, replace(joint, poses=larger, log_marginal=joint.log_marginal - 50 - difference)
    )
    shrunk = ModelFit(model, replace(worse.joint, log_marginal=joint.log_marginal - difference))
    assert _odds(shrunk, fit, observations, 1.0) == pytest.approx(1.0)
    assert _odds(worse, fit, observations, 1.0) < 1.0
