"""The rendered sessions: what each of them hides is found first, with its numbers, and nothing else
is.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.corners.detect_all import detect
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.rays import detected_off, map_error

FIXTURES = Path(__file__).parents[2] / "fixtures"
HIDDEN = {
    "bow": ("board_shape",),
    "stretch": ("board_scale",),
    "shutter": ("rolling_shutter",),
    "bump": ("fine_surface",),
    "two": ("board_shape", "board_scale"),
    "wave": ("free_field",),
    "tilted": (),
    "clean": (),
    "charuco": (),
    "aprilgrid": (),
}


@pytest.fixture(params=HIDDEN)
def finding(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Calibration, Diagnosis]:
    name: str = request.param
    shutil.copytree(FIXTURES / name, tmp_path / name)
    session, holdout = read_session(tmp_path / name), read_session(tmp_path / name / "holdout")
    return name, *diagnose(fit(session, Settings(), Silent()), Silent(), holdout)


def detector_error(name: str, folder: Path) -> float:
    """px RMS between the detected corners of the held-out views and the true ones."""
    session = read_session(folder / name / "holdout")
    with np.load(FIXTURES / name / "holdout" / "truth.npz") as truth:
        error = detected_off(detect(session.frames, session.board).views, truth["corners"])
    return float(np.sqrt((error**2).sum(-1).mean()))


@pytest.mark.slow
def test_hidden_effects_are_found(
    finding: tuple[str, Calibration, Diagnosis], tmp_path: Path
) -> None:
    """Held out, the error ends within a twentieth of the detector's own, against the true corners
    of the same pictures: 0.98 to 1.03 times it was measured (0.91 of bump, whose detector's error
    is partly the same in all views), as six numbers of a pose take up 2 % of it and what the fit
    does not know adds a little more. Of a moving board, half of the corners tell twelve numbers for
    the other half: 1.05 was measured (0.017 px), and as noise explains 7 %, as much again is
    allowed.
    """
    name, better, finding_of_session = finding
    print(
        name,
        finding_of_session.accepted,
        finding_of_session.base_quality.held_out_px,
        finding_of_session.final_quality.held_out_px,
    )
    assert finding_of_session.accepted == HIDDEN[name]
    with np.load(FIXTURES / name / "truth.npz") as truth:
        truth_of = dict(truth)
    parameters = {
        key: pair for results in better.effects for key, pair in results.parameters.items()
    }
    if "board_shape" in HIDDEN[name]:
        for axis, true in zip("xy", truth_of["board_bow"], strict=True):
            value, sigma = parameters[f"board_shape.{2 * axis}"]
            assert abs(float(value) - true) < 3 * float(sigma)
    if "board_scale" in HIDDEN[name]:
        value, sigma = parameters["board_scale.x_over_y"]
        assert (
            abs(float(value) - truth_of["print_stretch"]) < 3 * float(sigma) + 2e-5
        )  # its square: that is a ratio, ours a difference
    assert finding_of_session.final_quality.held_out_px < (
        1.12 if name == "shutter" else 1.05
    ) * detector_error(name, tmp_path)
    if name == "tilted":  # absorbed by the relief: nothing to find, and the maps are right
        error = map_error(better, FIXTURES / name / "truth.npz", near=40.0)
        print(error.by_depth)
        assert max(error.by_depth.values()) < 0.15
    if name == "wave":
        assert (
            finding_of_session.formulas[0].words
            == f"a wave of {1e3 * truth_of['print_wave'][1]:.0f} mm along x"
        )
        assert finding_of_session.formulas[0].explains > 0.95
    if HIDDEN[name]:
        assert (
            finding_of_session.final_quality.held_out_px
            < 0.6 * finding_of_session.base_quality.held_out_px
        )
