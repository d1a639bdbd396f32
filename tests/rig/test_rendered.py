"""Rigs that a renderer recorded, which knows nothing of our rays."""

from pathlib import Path

import numpy as np
import pytest

from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rig-cones", "rig-window"])
def test_a_rendered_rig_is_calibrated_to_its_sigma(name: str) -> None:
    rig = fit_rig(FIXTURES / name / "rig.yaml")
    with np.load(FIXTURES / name / "truth.npz") as truth:
        true = np.linalg.norm(truth["moved"][1] - truth["moved"][0])
    (baseline,) = rig.baselines
    print(baseline)
    assert abs(baseline.metres - true) < 3 * baseline.sigma
    held_out = evaluate_rig(rig, FIXTURES / name / "holdout" / "rig.yaml")
    print(held_out.rms_px)
    assert held_out.rms_px < 0.025, "the corners' noise is 0.018"
