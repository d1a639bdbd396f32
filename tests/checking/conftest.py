"""One calibrated camera of each shape, for all tests of checking."""

import pytest

from calib.checking.check import Checker
from fixtures.later import COVERS, camera
from fixtures.synthetic import Scene

Made = dict[str, tuple[Scene, Checker]]


@pytest.fixture(scope="package")
def cameras() -> Made:
    """Return each shape's camera as it was calibrated, and its calibration."""
    made = {shape: camera(shape, 3) for shape in COVERS}
    return {shape: (scene, Checker.of(calibration)) for shape, (scene, calibration) in made.items()}
