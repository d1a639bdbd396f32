"""From photographs of fringes through uneven glass to maps: noise of 2 grey levels, gamma 2.2, JPEG
of quality 90.
"""

from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from fixtures.covered_screen import map_errors_of, photograph_session


@pytest.mark.slow
def test_photographs_of_a_screen_tell_the_glass(tmp_path: Path) -> None:
    made = photograph_session(tmp_path / "session", seed=1, views=6)
    assert main(["fit", str(tmp_path / "session")]) == 0
    calibration = Calibration.load(tmp_path / "session" / "calibration")
    noise, residual = calibration.noise_px, calibration.stages[-1].rms_px
    assert noise
    assert 0.8 < residual / noise < 1.25
    assert calibration.stages[0].rms_px > 2 * residual  # what the camera alone leaves
    for depth in (0.3, 0.6, 1.2):
        error, sigma = map_errors_of(made, calibration, depth)
        rms = float(np.sqrt(np.mean(error**2)))
        predicted = float(np.sqrt(np.mean(sigma**2)))
        print(f"{rms:.4f} px at {depth} m, {predicted:.4f} predicted")
        assert rms < min(0.006, 1.25 * predicted)
