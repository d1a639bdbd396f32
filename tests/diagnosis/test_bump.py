"""A drop on the glass, which few rays pass."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch

from calib.calibration import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.effects.fine_surface import FineSurface
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.inference.calibration_model import full_model
from calib.inference.effect_context import place_of_bump, point_on_glass
from calib.inference.fitted_model import FittedModel
from calib.progress import Silent
from calib.session.session import read_session
from calib.threads import single_thread
from calib.verdict.differing_views import BUMP
from calib.verdict.judge import judge
from tests.diagnosis.hide import fitted, hidden

FIXTURES = Path(__file__).parents[2] / "fixtures"
PLACE = (-0.001, 0.02)
"""m along the axis of the cone, rad around it."""
METRES = (1.0, 0.045)
DROP = FineSurface(PLACE, PLACE, METRES, 5e-4)
HEIGHT = 6e-6
SIZES = {
    "fine_surface.height": HEIGHT,
    "fine_surface.first": 0.0,
    "fine_surface.second": 0.0,
    "fine_surface.width": 5e-4,
}
CLOSE = 4e-4
"""m: the scan tries places in steps of a quarter of its widths, 0.1 to 0.4 mm."""


@pytest.fixture(scope="module")
def dropped() -> Calibration:
    return fitted(hidden(DROP, SIZES, 2, 24))


def test_the_scan_finds_the_place(dropped: Calibration) -> None:
    model = full_model(dropped)
    with single_thread():
        joint = model.fit(dropped.observations, torch.from_numpy(dropped.poses))
        fit = FittedModel(model, dropped.observations, joint)
        place = place_of_bump(fit)
    assert place
    bump = point_on_glass(fit, torch.tensor(place.chart).double())
    true = point_on_glass(fit, torch.tensor(PLACE).double())
    assert (bump - true).norm() < CLOSE


@pytest.mark.slow
def test_a_drop_is_named_with_its_place_and_nothing_else_is(dropped: Calibration) -> None:
    _, finding = diagnose(dropped, Silent())
    assert finding.accepted == ("fine_surface",)
    bump = next(candidate for candidate in finding.candidates if candidate.accepted)
    assert bump.form == "bump"
    height = bump.parameters["fine_surface.height"]
    assert abs(height.value - HEIGHT) < 4 * height.sigma + 0.05 * HEIGHT
    sentence = next(remark for remark in finding.remarks if "clean the glass" in remark)
    assert sentence.startswith("There is a bump of ")
    assert sentence.endswith(" mm wide.")


@pytest.mark.slow
def test_a_fit_names_a_bump_before_it_says_that_something_differs(tmp_path: Path) -> None:
    """The rendered drop looks as if the lens had two values."""
    shutil.copytree(FIXTURES / "bump", tmp_path / "bump")
    calibration = fit(read_session(tmp_path / "bump"), Settings(), Silent())
    sentences = [reason.sentence for reason in judge(calibration).reasons]
    assert BUMP in sentences
    assert not any("from view to view" in sentence for sentence in sentences)
