"""A session through every shape of cover: from corners to a calibration that is saved, loaded and
asked.
"""

from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.synthetic import HEIGHT, WIDTH, scene
from tests.optics.shapes import Example, each_shape
from tests.test_calibration import write_session


@each_shape
@pytest.mark.parametrize(
    "moved",
    [
        pytest.param(False, id="in air"),
        pytest.param(True, id="moved, under water", marks=pytest.mark.slow),
    ],
)
def test_a_session_is_fitted_through_every_stage(
    example: Example, moved: bool, tmp_path: Path
) -> None:
    cover = example.changed(example.moved if moved else {})
    made = scene(11, views=8, amplitude=5e-5, noise=0.01, cover=cover, patch=example.patch)
    calibration = fit(
        read_session(write_session(tmp_path, made)), Settings(grid=(7, 6), steps=60), Silent()
    )
    errors_px = [stage.rms_px for stage in calibration.stages]
    pinhole, smooth, uneven = errors_px
    assert smooth < (0.2 if moved else 1.0) * pinhole, (
        "in air some covers are almost invisible; water bends much"
    )
    assert uneven < 0.35 * smooth
    assert uneven < 0.03
    assert len(calibration.views) == 8

    back = Calibration.load(calibration.save(tmp_path / "out"))
    pixels = np.random.default_rng(0).uniform(0, [WIDTH, HEIGHT], (100, 2))
    origins, directions = back.rays(pixels)
    for ours, theirs in zip(calibration.rays(pixels), (origins, directions), strict=True):
        assert np.abs(ours - theirs).max() < 1e-15  # millimetres in the file cost the last bit
    assert np.abs(back.project(origins + 0.7 * directions) - pixels).max() < 1e-6
