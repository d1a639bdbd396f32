"""A small pair of cameras behind flat, even windows in water, and its fit, which the tests of rigs
share.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.fit_record.request import Settings
from calib.rig.fit_rig import fit_rig
from calib.rig.rig import Rig
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.schema import Number
from fixtures.rigs import SimulatedRig, simulate_rig
from fixtures.synthetic import FLAT_PLACE, WATER, glass

EVEN = Settings(grid=(1, 1), flat_board=True)
WINDOW = glass("flat", 0.006, outside_index=WATER, **FLAT_PLACE)
"""In air, the distance of a flat window changes nothing."""
BOARD = Board(6, 5, 0.03)
WIDTH, HEIGHT = 410, 308
"""px, of the small pictures."""
SCALE = 8
DEPTH = 0.7
"""m"""


@pytest.fixture(scope="session")
def pair() -> SimulatedRig:
    return simulate_rig(3, WINDOW, placements=12, amplitude=0.0, board=BOARD)


@pytest.fixture(scope="session")
def pair_folder(pair: SimulatedRig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pair.write(tmp_path_factory.mktemp("pair")).parent


@pytest.fixture(scope="session")
def fitted(pair_folder: Path) -> Rig:
    return fit_rig(pair_folder, EVEN)


@pytest.fixture(scope="session")
def small(fitted: Rig) -> Rig:
    """The same pair with small pictures, and without the views of its fit."""
    calibrations = {}
    for name, calibration in fitted.calibrations.items():
        k = calibration.camera.intrinsics
        assert k
        numbers = (
            k.fx.value / SCALE,
            k.fy.value / SCALE,
            (k.cx.value + 0.5) / SCALE - 0.5,
            (k.cy.value + 0.5) / SCALE - 0.5,
        )
        fx, fy, cx, cy = map(Number, numbers)
        calibrations[name] = replace(
            calibration,
            camera=Camera(WIDTH, HEIGHT, intrinsics=Intrinsics(fx, fy, cx, cy)),
            views=(),
            poses=np.zeros((0, 6)),
            covariance=np.zeros((0, 0)),
            corners_at=np.array([[WIDTH / 2, HEIGHT / 2, DEPTH]]),
        )
    no_views = dict.fromkeys(calibrations, np.zeros(0, np.int64))
    return replace(
        fitted, calibrations=calibrations, covariance=np.zeros((0, 0)), of_views=no_views
    )
