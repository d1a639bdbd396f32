"""A small pair of cameras behind flat, even windows in water, and its fit, which the tests of rigs
share.
"""

from pathlib import Path

import pytest

from calib.fit_record.request import Settings
from calib.rig.fit_rig import fit_rig
from calib.rig.rig import Rig
from calib.session.board import Board
from fixtures.rigs import SimulatedRig, simulate_rig
from fixtures.synthetic import FLAT_PLACE, WATER, glass

EVEN = Settings(grid=(1, 1), flat_board=True)
WINDOW = glass("flat", 0.006, outside_index=WATER, **FLAT_PLACE)
"""In air, the distance of a flat window changes nothing."""
BOARD = Board(6, 5, 0.03)


@pytest.fixture(scope="session")
def pair() -> SimulatedRig:
    return simulate_rig(3, WINDOW, placements=12, amplitude=0.0, board=BOARD)


@pytest.fixture(scope="session")
def pair_folder(pair: SimulatedRig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pair.write(tmp_path_factory.mktemp("pair")).parent


@pytest.fixture(scope="session")
def fitted(pair_folder: Path) -> Rig:
    return fit_rig(pair_folder, EVEN)
