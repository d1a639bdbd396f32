"""The model of a calibration is fitted again to the same views: it ends where the fit ended."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.estimation.residuals import residuals
from calib.inference.calibration_model import fit_again, full_model
from calib.optics.build import covered_path
from calib.session.camera import unknown_intrinsics
from calib.session.schema import Number
from fixtures.calibrated import CAMERA
from fixtures.synthetic import COVERS, INTRINSICS, held, scene
from tests.fitting.test_unknown_numbers import calibrate

WIDE = replace(INTRINSICS, fx=Number(700.0), fy=Number(700.0))


def test_a_fit_with_an_unknown_lens_ends_at_the_same_optimum_again() -> None:
    """From the middle of the usual range of focal lengths it ended elsewhere, with 655 px."""
    cover = COVERS["dome"][0]
    path, values = covered_path(WIDE, cover)
    made = replace(scene(1, views=1, cover=cover), path=path, values=values)
    made = held(np.random.default_rng(1), made, 16, 0.1, (0.2, 0.8))
    calibration = calibrate(made, unknown_intrinsics(CAMERA), cover)
    model = full_model(calibration)
    again = fit_again(calibration, model)
    error = residuals(model.path, again.values, calibration.observations, again.poses).rms_px
    assert torch.isfinite(again.covariance).all()
    assert error == pytest.approx(calibration.stages[-1].rms_px, rel=0.01)
