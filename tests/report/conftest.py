"""Calibrations that many tests report on: 45 views with their pictures and their report, and a few
views without.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from calib.calibration import Calibration
from calib.fitting.provenance import provenance
from calib.session.session import read_session
from fixtures.synthetic import paper_cone, scene
from tests.report.made import add_pictures, calibrated, report_in


@dataclass(frozen=True)
class Reported:
    calibration: Calibration
    session: Path
    path: Path

    @property
    def html(self) -> str:
        return self.path.read_text()


@pytest.fixture(scope="session")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Reported:
    folder = tmp_path_factory.mktemp("reported")
    made = scene(11, views=45, amplitude=1e-5, noise=0.05, cover=paper_cone(0.00115))
    session = folder / "session"
    calibration = calibrated(made, session)
    add_pictures(session, made)
    request = replace(calibration.request, provenance=provenance(read_session(session)))
    calibration = replace(calibration, request=request)
    (session / "calibration").mkdir()
    return Reported(calibration, session, report_in(session / "calibration", calibration))


@pytest.fixture(scope="session")
def small_calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """12 views, no pictures."""
    return calibrated(
        scene(7, views=12, amplitude=1e-5, noise=0.05), tmp_path_factory.mktemp("few")
    )
