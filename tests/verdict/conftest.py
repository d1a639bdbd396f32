"""A good calibration of a synthetic session, which each test spoils in one respect."""

import pytest

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from fixtures.synthetic import paper_cone, scene
from tests.report.made import calibrated

FAST = Settings(grid=(5, 5), free=("none",))


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """24 views at 0.35 to 1.2 m, 1.15 mm of uneven glass, 0.05 px of noise per axis, every number
    held.
    """
    made = scene(11, views=24, noise=0.05, depths=(0.35, 1.2), cover=paper_cone(0.00115))
    return calibrated(made, tmp_path_factory.mktemp("good"), FAST)


@pytest.fixture(scope="session")
def freed(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """The same with every number estimated."""
    made = scene(11, views=24, noise=0.05, depths=(0.35, 1.2), cover=paper_cone(0.00115))
    return calibrated(made, tmp_path_factory.mktemp("freed"), Settings(grid=(5, 5), free=("all",)))
