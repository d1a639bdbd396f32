"""Rigs that a renderer recorded, which knows nothing of our rays."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.judge import judge_rig
from calib.rig.rig import Rig
from calib.rig.rig_effects import SYNC_OFFSET

FIXTURES = Path(__file__).parents[2] / "fixtures"
MAX_HELD_OUT_PX = 0.025
"""The corners' noise is 0.018 px."""


def distances(name: str) -> NDArray[np.float64]:
    """Return the true distances, m, between each two cameras of a rendered rig."""
    with np.load(FIXTURES / name / "truth.npz") as truth:
        centres = [
            -Rotation.from_rotvec(turned).inv().apply(moved)
            for turned, moved in zip(truth["turned"], truth["moved"], strict=True)
        ]
    return np.array([np.linalg.norm(a - b) for a, b in combinations(centres, 2)])


def check_rig_against_truth(rig: Rig, name: str) -> None:
    """Check the baselines against their sigmas, and the error on held-out placements."""
    for baseline, true in zip(rig.baselines, distances(name), strict=True):
        print(baseline, true, (baseline.metres - true) / baseline.sigma)
        assert abs(baseline.metres - true) < 3 * baseline.sigma
    held_out = evaluate_rig(rig, FIXTURES / name / "holdout" / "rig.yaml")
    print(held_out.rms_px)
    assert held_out.rms_px < MAX_HELD_OUT_PX


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rig-cones", "rig-window", "rig-dome"])
def test_a_rendered_rig_is_calibrated_to_its_sigma(name: str) -> None:
    check_rig_against_truth(fit_rig(FIXTURES / name / "rig.yaml"), name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rig-cones", "rig-window"])
def test_no_camera_of_a_rig_in_time_is_late(name: str) -> None:
    _, diagnosis = diagnose_rig(fit_rig(FIXTURES / name / "rig.yaml"))
    print(diagnosis.accepted, [(c.effect, c.log_odds) for c in diagnosis.candidates])
    assert SYNC_OFFSET.name not in diagnosis.accepted


@pytest.mark.slow
def test_a_late_camera_behind_an_uneven_cone_is_found() -> None:
    """The errors are 40 times those of the corners, and bend the covers of a fit that gives them
    the weight of corners.
    """
    rig = fit_rig(FIXTURES / "rig-late" / "rig.yaml")
    assert any("the diagnosis tells which" in r.sentence for r in judge_rig(rig).reasons)
    for calibration in rig.calibrations.values():
        assert np.abs(calibration.amplitudes).max() < 1e-3, "glass is even to tens of micrometres"
    better, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == (SYNC_OFFSET.name,)
    (effect,) = diagnosis.found
    late = effect.parameters["sync_offset.late"]
    print(effect.sentence)
    with np.load(FIXTURES / "rig-late" / "truth.npz") as truth:
        true = truth["late_s"][1]
    assert effect.camera == "right"
    assert abs(late.value - true) < 3 * late.sigma < 1e-4
    check_rig_against_truth(better, "rig-late")
