"""Pictures of which something is hidden: a second look, led by the model, finds what is left to
find, and moves nothing else.
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
from calib.fitting.fit import fit
from calib.fitting.guided_redetection import REDETECTION, Redetection, describe_redetection
from calib.fitting.stages import Settings
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
    """Eight of the fixture's pictures, with a grey disc over one end of the board or its middle in
    some.
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
def partly(place: Path) -> Calibration:
    return fit(read_session(place), SETTINGS, Silent())


@pytest.fixture(scope="module")
def whole(
    tmp_path_factory: pytest.TempPathFactory, truth: dict[str, NDArray[np.float64]]
) -> Calibration:
    return fit(
        read_session(session(tmp_path_factory.mktemp("whole") / "s", truth, {})), SETTINGS, Silent()
    )


def test_hidden_boards_are_used_with_all_corners_that_can_be_seen(
    partly: Calibration, truth: dict[str, NDArray[np.float64]]
) -> None:
    looks = {look["file"]: look for look in partly.settings[REDETECTION]}
    assert looks.keys() == HIDDEN.keys()
    assert (
        sum(look["found"] for look in looks.values()) >= 3
    )  # 6: the others were found as the picture alone goes on
    for view in partly.views:
        off = (view.corners - truth[view.name[:4]])[view.seen]
        assert np.sqrt((off**2).sum(1).mean()) < 0.03, (
            view.name
        )  # 0.017 and less were measured, 0.0276 with a corner that is touched
        if view.name not in HIDDEN:
            assert view.count == 81
            continue
        assert view.count >= {"end": 60, "middle": 76}[HIDDEN[view.name]]
        assert 81 - view.count == looks[view.name]["refused"] + looks[view.name]["dropped"]
        assert np.isnan(np.asarray(view.covariance)[~view.seen]).all()


def test_views_that_lost_nothing_are_unchanged(partly: Calibration, whole: Calibration) -> None:
    before = {view.name: view for view in whole.views}
    assert not whole.settings[REDETECTION]
    for view in partly.views:
        if view.name not in HIDDEN:
            np.testing.assert_array_equal(view.corners, before[view.name].corners)


def test_the_camera_is_as_if_nothing_were_hidden(partly: Calibration, whole: Calibration) -> None:
    """Half the corners' own noise, 0.008 px per axis and 8 views, is left in a map."""
    pixels = np.stack(
        np.meshgrid(np.linspace(300, 1340, 9), np.linspace(250, 1000, 7)), -1
    ).reshape(-1, 2)
    (ours, along), (theirs, straight) = partly.rays(pixels), whole.rays(pixels)
    apart = np.linalg.norm((ours + 0.5 * along) - (theirs + 0.5 * straight), axis=1)
    assert np.nanmedian(apart) < 1e-4  # m at 0.5 m: a quarter of a pixel


def test_the_same_pictures_give_the_same_corners(place: Path, partly: Calibration) -> None:
    """Now from what is kept of the detection, where it was made anew before."""
    again = fit(read_session(place), SETTINGS, Silent())
    for one, other in zip(partly.views, again.views, strict=True):
        np.testing.assert_array_equal(one.corners, other.corners)
        np.testing.assert_array_equal(one.weight, other.weight)
    np.testing.assert_array_equal(partly.amplitudes, again.amplitudes)


def test_it_is_said(
    partly: Calibration, whole: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    said = summary(partly, 1.0)
    assert said[REDETECTION] == partly.settings[REDETECTION]
    print_fit(partly, 1.0)
    lines = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("Second look for corners: ")
    ]
    assert len(lines) == 1
    assert "found where the model puts them" in lines[0]
    assert "are covered, or do not look like corners" in lines[0]
    print_fit(whole, 1.0)
    assert "Second look" not in capsys.readouterr().out


def test_the_line_counts_views() -> None:
    looks = [Redetection("a", 3, 1, 0), Redetection("b", 0, 2, 0), Redetection("c", 4, 0, 1)]
    assert (
        describe_redetection(looks)
        == "Second look for corners: 7 in 2 views found where the model puts them; 3 in 2 views are"
        " covered, or do not look like corners where the model puts them; 1 in 1 view dropped,"
        " as they do not look like corners after all."
    )
    assert describe_redetection([]) == ""
    assert looks[0].record() == {"file": "a", "found": 3, "refused": 1, "dropped": 0}
