"""Tests of a calibration as the prior of a check."""

import numpy as np
import torch

from calib.calibration import Calibration
from calib.checking.prior import CalibrationPrior
from calib.estimation.covariance import covariance_root
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.optics.exposure import MIDDLE
from fixtures.calibrated import CAMERA, calibrate, tolerant
from fixtures.synthetic import INTRINSICS, scene

MOVED = {"cover.axis_offset.x": 2e-5, "cover.tilt.x": 2e-4, "cover.inner_radius": 2e-5}
"""m or rad: small changes of the cover's numbers."""


def calibration() -> Calibration:
    made = scene(5, views=10, noise=0.02, amplitude=3e-5)
    return tolerant(made, Setup(made.board, CAMERA, INTRINSICS, made.cover), Settings(grid=(8, 8)))


def test_the_relief_is_fixed_to_a_cover_that_moves() -> None:
    """A step of the fit's parameters bends the rays as the same step of the check's parameters
    does, although the relief of the one stays where the camera sees it, and that of the other on
    the glass. Oracle: both paths are traced.
    """
    fitted = calibration()
    assert fitted.relief
    assert fitted.relief.anchor
    model, prior = fitted.camera_model(), CalibrationPrior.of(fitted)
    assert prior.model.path.relief
    assert prior.model.path.relief.anchor is None
    pixels = fitted.observations.pixels[::20]
    parameters = model.parameters
    to_fixed = torch.from_numpy(prior.root @ np.linalg.inv(covariance_root(fitted.covariance)))
    for name, change in MOVED.items():
        step = torch.zeros(parameters.count, dtype=torch.float64)
        scale = next(param.scale for param in parameters.free if param.name == name)
        step[parameters.slices()[name]] = change / scale
        values = parameters.values(step)
        same = prior.parameters.values(to_fixed @ step)
        start = model.path.trace(pixels, model.means, MIDDLE).direction.stacked()
        ours = model.path.trace(pixels, values, MIDDLE).direction.stacked() - start
        theirs = prior.model.path.trace(pixels, same, MIDDLE).direction.stacked() - start
        plain = prior.model.path.trace(pixels, values, MIDDLE).direction.stacked() - start
        missed = (ours - theirs).norm() / (ours - plain).norm()
        assert missed < 0.02, name  # second order, and what the amplitudes cannot represent


def test_nothing_changes_where_every_number_is_held() -> None:
    made = scene(5, views=10, noise=0.02, amplitude=3e-5)
    held = calibrate(made, Settings(grid=(6, 6)))
    root = covariance_root(held.covariance)
    assert np.array_equal(CalibrationPrior.of(held).root, root)
