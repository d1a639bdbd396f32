"""Pictures with a partly hidden board: the redetection that the model guides finds the remaining
corners and moves no others.
"""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.commands.console import print_fit
from calib.commands.fit_command import summary
from calib.fit_record.history import History
from calib.fit_record.outcome import FitOutcome, Redetection
from calib.fit_record.record_file import record_from_yaml, record_to_yaml
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.fit import fit
from calib.fitting.guided_redetection import describe_redetection
from calib.io.images import read_grey
from calib.progress import Silent
from calib.session.session import read_session

FIXTURE = Path(__file__).parents[2] / "fixtures" / "bumps"
SETTINGS = Settings(grid=(6, 6), free=("none",))
HIDDEN = {"0004.png": "end", "0006.png": "end", "0007.png": "middle", "0010.png": "middle"}
SHOWN = range(4, 12)


@pytest.fixture(scope="module")
def truth() -> dict[str, NDArray[np.float64]]:
    with np.load(FIXTURE / "truth.npz") as file:
        return {f"{number:04}": corners for number, corners in enumerate(file["corners"])}


def session(folder: Path, truth: dict[str, NDArray[np.float64]], hidden: dict[str, str]) -> Path:
    """Write eight of the fixture's pictures, some with a grey disc over one end or the middle of
    the board.
    """
    (folder / "frames").mkdir(parents=True)
    shutil.copy(FIXTURE / "session.yaml", folder)
    for number in SHOWN:
        name = f"{number:04}"
        picture, corners = read_grey(FIXTURE / "frames" / f"{name}.jpg").copy(), truth[name]
        diagonal = float(np.linalg.norm(corners[0] - corners[80]))
        middle, radius = {
            "end": (corners[80], 0.3),
            "middle": (corners[40] + 3, 0.05),
            "": (corners[0], 0.0),
        }[hidden.get(f"{name}.png", "")]
        if radius:
            cv2.circle(
                picture,
                tuple(np.rint(middle).astype(int).tolist()),
                int(radius * diagonal),
                120,
                -1,
            )
        assert cv2.imwrite(str(folder / "frames" / f"{name}.png"), picture)
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, truth: dict[str, NDArray[np.float64]]) -> Path:
    return session(tmp_path_factory.mktemp("hidden") / "s", truth, HIDDEN)


@pytest.fixture(scope="module")
def hidden_fit(place: Path) -> Calibration:
    return fit(read_session(place), SETTINGS, Silent())


@pytest.fixture(scope="module")
def full_fit(
    tmp_path_factory: pytest.TempPathFactory, truth: dict[str, NDArray[np.float64]]
) -> Calibration:
    return fit(
        read_session(session(tmp_path_factory.mktemp("whole") / "s", truth, {})), SETTINGS, Silent()
    )


@pytest.mark.slow
def test_partly_hidden_boards_are_used_with_all_visible_corners(
    hidden_fit: Calibration, truth: dict[str, NDArray[np.float64]]
) -> None:
    looks = {look.file: look for look in hidden_fit.outcome.redetections or ()}
    assert looks.keys() == HIDDEN.keys()
    assert (
        sum(look.new_corners for look in looks.values()) >= 3
    )  # 6: the others were found as the picture alone goes on
    for view in hidden_fit.views:
        error = (view.corners - truth[view.name[:4]])[view.seen]
        assert np.sqrt((error**2).sum(1).mean()) < 0.03, (
            view.name
        )  # 0.017 and less were measured, 0.0276 with a corner that is touched
        blur = np.asarray(view.blur)
        assert np.array_equal(np.isfinite(blur).all(1), view.seen)
        assert np.isnan(blur[~view.seen]).all()
        if view.name not in HIDDEN:
            assert view.count == 81
            continue
        assert view.count >= {"end": 60, "middle": 76}[HIDDEN[view.name]]
        assert 81 - view.count == looks[view.name].refused + looks[view.name].dropped
        assert np.isnan(np.asarray(view.covariance)[~view.seen]).all()


@pytest.mark.slow
def test_views_without_hidden_corners_are_unchanged(
    hidden_fit: Calibration, full_fit: Calibration
) -> None:
    expected = {view.name: view for view in full_fit.views}
    assert not full_fit.outcome.redetections
    for view in hidden_fit.views:
        if view.name not in HIDDEN:
            np.testing.assert_array_equal(view.corners, expected[view.name].corners)


@pytest.mark.slow
def test_the_camera_agrees_with_the_fit_to_full_boards(
    hidden_fit: Calibration, full_fit: Calibration
) -> None:
    """Half the corners' own noise, 0.008 px per axis and 8 views, is left in a map."""
    pixels = np.stack(
        np.meshgrid(np.linspace(300, 1340, 9), np.linspace(250, 1000, 7)), -1
    ).reshape(-1, 2)
    hidden_origins, hidden_directions = hidden_fit.rays(pixels)
    origins, directions = full_fit.rays(pixels)
    distance = np.linalg.norm(
        (hidden_origins + 0.5 * hidden_directions) - (origins + 0.5 * directions), axis=1
    )
    assert np.nanmedian(distance) < 1e-4  # m at 0.5 m: a quarter of a pixel


@pytest.mark.slow
def test_the_same_pictures_give_the_same_corners(place: Path, hidden_fit: Calibration) -> None:
    """The second fit reads the cached detection; the first fit made it."""
    second_fit = fit(read_session(place), SETTINGS, Silent())
    for first, second in zip(hidden_fit.views, second_fit.views, strict=True):
        np.testing.assert_array_equal(first.corners, second.corners)
        np.testing.assert_array_equal(first.weight, second.weight)
    np.testing.assert_array_equal(hidden_fit.amplitudes, second_fit.amplitudes)


@pytest.mark.slow
def test_the_redetection_is_reported(
    hidden_fit: Calibration, full_fit: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    document = summary(hidden_fit, 1.0)
    assert document["second_look"] == hidden_fit.record()["second_look"]
    print_fit(hidden_fit, 1.0)
    lines = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("Second look for corners: ")
    ]
    assert len(lines) == 1
    assert "found where the model puts them" in lines[0]
    assert "are covered, or do not look like corners" in lines[0]
    print_fit(full_fit, 1.0)
    assert "Second look" not in capsys.readouterr().out


def test_the_line_counts_views() -> None:
    redetections = [Redetection("a", 3, 1, 0), Redetection("b", 0, 2, 0), Redetection("c", 4, 0, 1)]
    assert (
        describe_redetection(redetections)
        == "Second look for corners: 7 in 2 views found where the model puts them; 3 in 2 views are"
        " covered, or do not look like corners where the model puts them; 1 in 1 view dropped,"
        " as they do not look like corners after all."
    )
    assert describe_redetection([]) == ""
    outcome = FitOutcome(redetections=tuple(redetections))
    record = record_to_yaml(FitRequest(), outcome, History())
    assert record["second_look"][0] == {"file": "a", "found": 3, "refused": 1, "dropped": 0}
    assert record_from_yaml(record) == (FitRequest(), outcome, History())
