"""Sessions of small simulated cameras: six views, and a fit of a second."""

from pathlib import Path

import pytest

from calib.fit_record.request import Settings
from calib.fleet.identity import FleetOptions
from calib.session.board import Board
from fixtures.fleet import Line, write_session

LINE = Line(cameras=4, views=6, broken=(), board=Board(6, 6, 0.032))
QUICK = Settings(grid=(3, 3), free=("none",))
ASKED = FleetOptions(QUICK)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of four sessions; tests that change one copy it."""
    folder = tmp_path_factory.mktemp("sessions")
    for number in range(LINE.cameras):
        write_session(folder / LINE.name(number), LINE, number)
    return folder
