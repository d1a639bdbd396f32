"""One covered camera for all formats."""

import pytest

from calib.calibration import Calibration
from tests.export import truth


@pytest.fixture(scope="package")
def covered() -> Calibration:
    return truth.covered()


@pytest.fixture(scope="package")
def bare() -> Calibration:
    return truth.bare()


@pytest.fixture(scope="package")
def flat() -> Calibration:
    return truth.port("flat")


@pytest.fixture(scope="package")
def small() -> Calibration:
    return truth.small()
