"""Calibrated dry, put under water, and confirmed there: three pictures say what the pictures in air
could not.
"""

from pathlib import Path

import pytest

from calib.apply.change_medium import immerse
from calib.calibration import Calibration
from calib.cli import main
from calib.diagnosis.all_free import all_free
from calib.fitting.fit import fit
from calib.session.schema import Number
from calib.session.session import read_session
from fixtures.rays import FIXTURES, map_error

POOL = FIXTURES / "wet-cone" / "water"
NEAR = 40.0
"""px: a pixel counts with three training corners that near."""


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An immersed calibration and its update."""
    folder = tmp_path_factory.mktemp("pool")
    immerse(all_free(fit(read_session(POOL.parent))), Number(1.34, 0.001)).calibration.save(folder)
    pictures = sorted(str(path) for path in (POOL / "frames").glob("*.jpg"))[:3]
    assert main(["check", str(folder), *pictures, "--update", "-o", str(folder / "updated")]) == 0
    return folder


@pytest.fixture(scope="module")
def dry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dry")
    fit(read_session(POOL.parent)).save(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("immersed", [False, True])
def test_pictures_in_the_other_medium_are_told(
    dry: Path, pool: Path, immersed: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """Water shifts the corners as no change of the cover that is possible could."""
    calibration = pool if immersed else dry
    frames = (POOL.parent if immersed else POOL) / "frames"
    pictures = sorted(map(str, frames.glob("*.jpg")))[:3]
    assert main(["check", str(calibration), *pictures]) == 5
    medium, index = ("in air", "1") if immersed else ("under water", "1.333")
    printed = capsys.readouterr().out
    assert f"taken {medium}" in printed
    assert f"calib immerse CALIBRATION --outside-index {index}`, with" in printed


def test_three_pictures_under_water_determine_what_air_could_not(pool: Path) -> None:
    """Corners have 0.02 px of noise: what three views leave is of that size, where a calliper left
    more than three times as much.
    """
    initial = map_error(Calibration.load(pool), POOL / "truth.npz", NEAR).by_depth
    final = map_error(Calibration.load(pool / "updated"), POOL / "truth.npz", NEAR).by_depth
    assert min(initial.values()) > 0.06
    assert max(final.values()) < 0.05


def test_an_updated_calibration_can_be_used_as_any_other(
    pool: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    updated = Calibration.load(pool / "updated")
    assert [view.name for view in updated.views] == [
        "later-0000.jpg",
        "later-0001.jpg",
        "later-0002.jpg",
    ]  # no pictures of the session
    assert [stage.name for stage in updated.stages] == ["pinhole", "cover", "cover+rbf"]
    assert updated.stages[0].rms_px > 1 > 0.05 > updated.stages[-1].rms_px
    assert main(["report", str(pool / "updated")]) == 0
    assert main(["evaluate", str(pool / "updated"), str(POOL)]) == 0
    assert "a bug" not in capsys.readouterr().err
