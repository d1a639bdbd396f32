"""A calibration of PhotonVision as a session."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.cli import main
from calib.corners.corners_file import read_corners
from calib.errors import InputError, NotEnoughDataError
from calib.importing.from_photonvision import from_photonvision
from calib.session.board import Board

COLUMNS, ROWS, SQUARE = 7, 5, 0.0254
LENS = [0.1, -0.2, 0.001, -0.002, 0.05, 0.0, 0.0, 0.0]


def pixels(number: int) -> np.ndarray:
    """(ROWS * COLUMNS, 2) px."""
    grid = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), -1).reshape(-1, 2)
    return np.asarray(grid * [61.5, 60.25] + [40.0 + 7 * number, 50.0 + 5 * number])


def document(**changed: object) -> dict[str, object]:
    grid = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), -1).reshape(-1, 2) * SQUARE
    observations = [
        {
            "locationInObjectSpace": [{"x": x, "y": y, "z": 0.0} for x, y in grid.tolist()],
            "locationInImageSpace": [{"x": x, "y": y} for x, y in pixels(number).tolist()],
            "reprojectionErrors": [],
            "cornersUsed": [True] * (len(grid) - 1) + [False],
            "snapshotName": "img0.png",
        }
        for number in range(3)
    ]
    matrix = [600.0, 0.0, 319.5, 0.0, 601.0, 239.5, 0.0, 0.0, 1.0]
    return {
        "resolution": {"width": 640.0, "height": 480.0},
        "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": matrix},
        "distCoeffs": {"rows": 1, "cols": 8, "type": 6, "data": LENS},
        "calobjectWarp": [0.0, 0.0],
        "observations": observations,
        "calobjectSize": {"width": 8.0, "height": 6.0},
        "calobjectSpacing": SQUARE,
        "lensmodel": "LENSMODEL_OPENCV",
        **changed,
    }


def written(folder: Path, content: object) -> Path:
    path = folder / "photon.json"
    path.write_text(json.dumps(content))
    return path


def test_its_corners_become_a_session(tmp_path: Path) -> None:
    out = tmp_path / "session"
    path = written(tmp_path, document())
    assert main(["import", "photonvision", str(path), "-o", str(out)]) == 0
    text = (out / "session.yaml").read_text()
    session = yaml.safe_load(text)
    assert session["board"]["columns"] == COLUMNS
    assert session["board"]["rows"] == ROWS
    assert session["board"]["square_mm"] == pytest.approx(25.4)
    assert (session["camera"]["width"], session["camera"]["height"]) == (640, 480)
    assert "PhotonVision's own lens" in text
    views = read_corners(out / "corners.vnl", Board(COLUMNS, ROWS, SQUARE))
    assert len(views) == 3
    assert np.abs(views[1].corners[:-1] - pixels(1)[:-1]).max() < 1e-6
    assert not views[1].seen[-1]  # an outlier


def test_a_part_of_a_board_stays_in_its_place(tmp_path: Path) -> None:
    """PhotonVision lists only the corners that a picture shows of a board with markers."""
    content = document()
    observations = content["observations"]
    assert isinstance(observations, list)
    for key in ("locationInObjectSpace", "locationInImageSpace"):
        observations[2][key] = observations[2][key][COLUMNS:]
    del observations[2]["cornersUsed"]
    draft = from_photonvision(written(tmp_path, content))
    assert not draft.views[2].seen[:COLUMNS].any()
    assert np.abs(draft.views[2].corners[COLUMNS:] - pixels(2)[COLUMNS:]).max() < 1e-9


@pytest.mark.parametrize(
    ("content", "error", "sentence"),
    [
        ([], InputError, "is not a calibration of PhotonVision"),
        (document(observations=[]), NotEnoughDataError, "holds no corners"),
        (document(resolution=5), InputError, "is damaged"),
        (document(calobjectSpacing=0.02), InputError, "no grid of squares"),
    ],
)
def test_what_is_not_its_file_is_refused(
    tmp_path: Path, content: object, error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        from_photonvision(written(tmp_path, content))
