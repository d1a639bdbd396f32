"""A calibration, and a recording of the same size."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from fixtures.known import known
from fixtures.synthetic import scene
from tests.capture.recordings import write_recording

SIZE = (328, 246)
COUNT = 8


@pytest.fixture(scope="session")
def calibration() -> Calibration:
    return known(scene(3, views=1, grid=(4, 4), amplitude=1e-5), *SIZE)


@pytest.fixture(scope="session")
def saved(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(calibration.save(tmp_path_factory.mktemp("calibration")))


@pytest.fixture(scope="session")
def pictures() -> list[np.ndarray]:
    """Smooth colours: what compression and a video's half colours leave nearly as they are."""
    spots = np.random.default_rng(0).integers(40, 216, (COUNT, 5, 6, 3), dtype=np.uint8)
    return [
        np.asarray(cv2.resize(each, SIZE, interpolation=cv2.INTER_CUBIC), np.uint8)
        for each in spots
    ]


@pytest.fixture(scope="session")
def recording(pictures: list[np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of pictures without times, which are played as fast as they are read."""
    return write_recording(tmp_path_factory.mktemp("recording"), pictures)
