"""The start of a fit without an effect is near its end, because the fit with the effect predicts
it.
"""

import pytest
import torch

from calib.effects.entrance_pupil import EntrancePupil
from calib.effects.lens import LensEffect
from calib.inference.calibration_model import base_model, full_model
from calib.inference.warm_start import start_without_effects
from tests.diagnosis.hide import without_cover


def test_the_start_without_an_effect_is_near_the_end_of_its_fit() -> None:
    """A pupil beside a lens, each of which does much of what the other does: without the pupil the
    lens's first coefficient is another by many of its sigmas, and nine tenths of that are there
    from the start.
    """
    lens, pupil = LensEffect(), EntrancePupil()
    calibration = without_cover(pupil, {"entrance_pupil.e2": 3e-3, "entrance_pupil.e4": 0.0}, 0.1)
    observations, model = calibration.observations, full_model(calibration)
    fit = model.fit(observations, torch.from_numpy(calibration.poses))
    both_effects = model.with_effects([lens, pupil])
    joint = both_effects.fit(observations, fit.poses, fit.start)
    alone = base_model(calibration).with_effects([lens])
    start = start_without_effects(alone, both_effects, joint, observations)
    end = alone.fit(observations, joint.poses, joint.start)
    name = "lens.k1"
    moved = float(end.values[name] - joint.values[name])
    assert abs(moved) > 5 * float(end.sigma_of(name))
    assert float(start.values[name] - joint.values[name]) == pytest.approx(moved, rel=0.1)
    refit = alone.fit(observations, joint.poses, start)
    assert refit.iterations <= end.iterations
    assert float(refit.values[name]) == pytest.approx(
        float(end.values[name]), abs=0.2 * float(end.sigma_of(name))
    )
