"""Pictures of a board by the programs that read an export, against one through the glass."""

from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main

pytest.importorskip("mitsuba", reason="mitsuba is not installed: its pictures are not there")
from fixtures import ray_camera_readers as readers
from fixtures.prints import CHECKERBOARD
from fixtures.ray_cameras import PLACE, TILT, difference, mitsuba_pictures, true_calibration

DEPTH = 0.36
"""m"""

pytestmark = pytest.mark.slow


def export(calibration: Calibration, folder: Path, *words: str) -> Path:
    calibration.save(folder / "saved")
    out = folder / words[0]
    assert main(["export", str(folder / "saved"), "--format", *words, "-o", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def glass(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    folder = export(true_calibration(), tmp_path_factory.mktemp("glass"), "mitsuba")
    _, picture = mitsuba_pictures(folder)
    return picture


def rms(picture: np.ndarray, glass: np.ndarray) -> float:
    """Return the px between the board's corners of two pictures."""
    return float(np.sqrt((difference(picture, glass) ** 2).sum(-1).mean()))


def test_ncore(glass: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("ncore", reason="nvidia-ncore is not installed")
    folder = export(true_calibration(), tmp_path, "windshield", "--depth", str(DEPTH))
    assert rms(readers.ncore_picture(folder, DEPTH), glass) < 0.03


def test_colmap(glass: np.ndarray, tmp_path: Path) -> None:
    """Its lens does not follow uneven glass; the file states 0.18 px over the whole picture."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    folder = export(true_calibration(), tmp_path, "colmap", "--depth", str(DEPTH))
    assert rms(readers.colmap_picture(folder, DEPTH), glass) < 0.18


def test_newton(glass: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("newton", reason="newton is not installed")
    folder = export(true_calibration(), tmp_path, "ray-image", "--axes", "opengl")
    assert rms(readers.newton_picture(folder), glass) < 0.03


def test_gaussians_are_darkest_where_the_camera_sees_their_middles(tmp_path: Path) -> None:
    calibration = true_calibration()
    picture = readers.gsplat_picture(export(calibration, tmp_path, "gsplat"))
    spacing = 2 * CHECKERBOARD.half / readers.SPLATS
    steps = np.stack(np.meshgrid([-9, 0, 7], [-5, 0, 8], [0]), -1).reshape(-1, 3)
    pixels = calibration.project(PLACE + np.asarray(spacing * steps) @ np.asarray(TILT).T)
    for x, y in pixels:
        column, row = int(x) - 3, int(y) - 3
        window = readers.SKY - picture[row : row + 8, column : column + 8]
        rows, columns = np.indices(window.shape)
        weights = window**4
        middle = [(weights * columns).sum() + 0.0, (weights * rows).sum() + 0.0]
        assert np.abs(middle / weights.sum() + [column, row] - [x, y]).max() < 0.3, "px"
