"""The difference of two fits in the picture."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.inference.calibration_model import full_model
from calib.inference.fitted_model import ModelFit
from calib.inference.vuong import robust_difference
from calib.threads import single_thread
from tests.diagnosis.hide import fitted, hidden

FOCAL = "camera.fx"


def two_fits() -> tuple[ModelFit, ModelFit, Observations]:
    """Return a fit, and one whose focal length is off by 0.05 %."""
    calibration = fitted(hidden(None, {}, 1, 10))
    model, observations = full_model(calibration), calibration.observations
    with single_thread():
        joint = model.fit(observations, torch.from_numpy(calibration.poses))
    values = {**joint.values, FOCAL: joint.values[FOCAL] * 1.0005}
    return ModelFit(model, joint), ModelFit(model, replace(joint, values=values)), observations


def test_it_is_that_of_the_likelihoods_and_no_single_corner_decides() -> None:
    better, worse, observations = two_fits()
    difference = robust_difference(better, worse, observations)
    assert robust_difference(worse, better, observations) == pytest.approx(-difference)
    squares = [
        float(
            (
                residuals(fit.model.path, fit.joint.values, observations, fit.joint.poses).image
                / fit.joint.sigma
            )
            .square()
            .sum()
        )
        for fit in (better, worse)
    ]
    normal = (squares[1] - squares[0]) / 2
    assert 0 < difference < normal  # Huber's loss grows less than that of a normal distribution
    pixels = observations.pixels.clone()
    pixels[0] += 20.0
    spoiled = replace(observations, pixels=pixels)
    assert robust_difference(better, worse, spoiled) == pytest.approx(difference, rel=0.05)
    assert np.isfinite(difference)
