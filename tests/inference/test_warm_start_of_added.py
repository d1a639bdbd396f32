"""A port under water is begun where it can be: poses and focal length have made up for it, and some
boards lie on the wrong side.
"""

from dataclasses import replace

import pytest
import torch

from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.flat_port import WATER, FlatPort
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import residuals
from calib.inference.calibration_model import full_model
from calib.inference.warm_start import start_with_effect
from tests.diagnosis.hide import without_cover

NOISE = 0.1
"""px per axis"""
FREE = ("camera.fx", "camera.fy")
Fitted = tuple[CameraModel, Observations, JointFit]


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    """A port in water that nobody declared, and a fit that knows none."""
    port = FlatPort("water")
    calibration = without_cover(
        port, {u.param.name: u.initial for u in port.effect_parameters}, NOISE, seed=3
    )
    model, observations = full_model(calibration), calibration.observations
    return model, observations, model.fit(observations, torch.from_numpy(calibration.poses))


def test_poses_start_anew_behind_a_port(fitted: Fitted) -> None:
    model, observations, joint = fitted
    wider = model.with_effect(FlatPort("water"))
    start = start_with_effect(wider, observations, joint)
    assert residuals(wider.path, start.values, observations, start.poses).rms_px < 2 * NOISE
    fit = wider.fit(observations, start.poses, start.start, ROUNDS)
    assert fit.sigma == pytest.approx(NOISE, rel=0.05)
    assert abs(float(fit.values["flat_port.outside_index"]) - WATER) < 0.002
    assert refit_poses(wider.path, start.values, observations, joint.poses)[1].rms_px > 1, (
        "the control: they lead into another valley"
    )


def test_a_focal_length_that_compensated_for_water_starts_near_its_true_value() -> None:
    """From where the fit without a port left it, the window ends without thickness and the error
    ten times as large.
    """
    port = FlatPort("water")
    calibration = without_cover(
        port, {u.param.name: u.initial for u in port.effect_parameters}, NOISE, seed=3
    )
    observations, base = calibration.observations, full_model(calibration)
    model = replace(base, priors=base.priors.with_sigmas(dict.fromkeys(FREE, 1000.0)))
    joint = model.fit(observations, torch.from_numpy(calibration.poses))
    true = {name: float(base.means[name]) for name in FREE}
    assert all(float(joint.values[name]) < 0.9 * true[name] for name in FREE)
    wider = model.with_effect(port)
    start = start_with_effect(wider, observations, joint)
    assert all(abs(float(start.values[name]) / true[name] - 1) < 0.05 for name in FREE)
    fit = wider.fit(observations, start.poses, start.start, ROUNDS)
    assert fit.sigma == pytest.approx(NOISE, rel=0.05)
    assert all(abs(float(fit.values[name]) / true[name] - 1) < 0.001 for name in FREE)


def test_an_effect_that_starts_neutral_keeps_the_earlier_fit(fitted: Fitted) -> None:
    model, observations, joint = fitted
    assert start_with_effect(model.with_effect(EntrancePupil()), observations, joint) is joint
    wider = model.with_effect(FlatPort("water"))
    at_neutral = replace(joint, values={**wider.means, **joint.values})
    assert start_with_effect(wider, observations, at_neutral) is at_neutral
