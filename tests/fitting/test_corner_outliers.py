"""Single corners at wrong places are left out; what has a cause stays."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.cli import main
from calib.estimation.residuals import residuals
from calib.fit_record.request import Settings
from calib.fitting.corner_outliers import describe_outlier_corners, find_outlier_corners
from calib.fitting.fit import fit
from fixtures.calibrated import GLASS, calibrate
from fixtures.map_errors import errors
from fixtures.synthetic import Scene, scene
from tests.diagnosis.hide import fitted, hidden
from tests.diagnosis.test_bump import DROP, SIZES
from tests.test_calibration import write_session

NOISE = 0.1  # px
WRONG = {0: {40: (6.0, 2.0)}, 3: {0: (-4.0, 4.0), 62: (0.0, 9.0)}, 7: {80: (25.0, 0.0)}}
"""px, the error of some corners by view: inside, in a corner and at the edge of the board."""
NAMES = {"0000.png": 1, "0003.png": 2, "0007.png": 1}
FREE = Settings(free=("none",), grid=(5, 4))


def with_wrong_corners(made: Scene) -> Scene:
    views = list(made.views)
    for index, shifts in WRONG.items():
        corners = views[index].corners.copy()
        for corner, shift in shifts.items():
            corners[corner] += shift
        views[index] = replace(views[index], corners=corners)
    return replace(made, views=tuple(views))


def outliers_of(calibration: Calibration) -> NDArray[np.bool_]:
    path, values = calibration.model()
    residual = residuals(
        path, values, calibration.observations, torch.from_numpy(calibration.poses)
    )
    return find_outlier_corners(calibration.views, residual, calibration.board, calibration.camera)


def test_wrong_corners_are_left_out(tmp_path: Path) -> None:
    made = scene(8, 12, noise=NOISE, cover=GLASS)
    spoiled = write_session(tmp_path / "spoiled", with_wrong_corners(made))
    calibration = fit(spoiled, FREE)
    assert calibration.outcome.outlier_corners == NAMES
    for index, view in enumerate(calibration.views):
        assert set(np.flatnonzero(~view.seen)) == set(WRONG.get(index, ()))
    clean = fit(write_session(tmp_path / "clean", made), FREE)
    assert clean.outcome.outlier_corners is None

    def sigma_and_error(result: Calibration) -> tuple[float, float]:
        error, sigma = map(np.concatenate, zip(*errors(made, result), strict=True))
        return float(np.sqrt((sigma**2).mean())), float(np.sqrt((error**2).mean()))

    # Four of 972 corners are lost, and nothing else.
    assert sigma_and_error(calibration) == pytest.approx(sigma_and_error(clean), rel=0.1)
    assert calibration.stages[-1].rms_px == pytest.approx(clean.stages[-1].rms_px, rel=0.02)


@pytest.mark.slow
def test_the_commands_say_which_corners_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = with_wrong_corners(scene(8, 12, noise=NOISE, cover=GLASS))
    place = write_session(tmp_path / "s", made)
    assert main(["fit", str(place), "--free", "none", "--grid", "5x4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outlier_corners"] == NAMES
    assert Calibration.load(place / "calibration").outcome.outlier_corners == NAMES
    report = (place / "calibration" / "report.html").read_text()
    assert "2 corners left out, far from their places" in report
    assert main(["fit", str(place), "--free", "none", "--grid", "5x4"]) == 0
    sentence = "4 corners of 3 views are pixels away from where neighbouring corners show them"
    assert sentence in capsys.readouterr().out


Shift = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""The (N, 2) px of a shift, from places on the board, over its half, and (N, 2) px."""
CAUSES: dict[str, Shift] = {
    "a column that is printed elsewhere": lambda board, _: np.where(
        np.abs(board[:, :1] - 0.5) < 0.1, [[1.5, 0.0]], 0.0
    ),
    "a print of two sheets": lambda board, _: np.where(board[:, :1] > 0.1, [[2.0, 0.5]], 0.0),
    "a step in the picture": lambda _, pixels: np.where(pixels[:, :1] > 1600, [[1.5, 0.0]], 0.0),
    "one row of pixels after the other": lambda _, pixels: np.column_stack(
        [1.0 * (np.round(pixels[:, 1]) % 2), np.zeros(len(pixels))]
    ),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_what_belongs_to_a_place_stays(cause: str) -> None:
    made = scene(9, 16, noise=NOISE, amplitude=0.0)
    board = made.board.points() / made.board.half
    views = tuple(
        replace(view, corners=view.corners + CAUSES[cause](board, view.corners))
        for view in made.views
    )
    assert not outliers_of(calibrate(replace(made, views=views), FREE)).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drop_on_the_glass_stays(seed: int) -> None:
    assert not outliers_of(fitted(hidden(DROP, SIZES, seed, 24))).any()


def test_half_of_the_corners_are_no_outliers() -> None:
    made = scene(9, 12, noise=NOISE, amplitude=0.0)
    rng = np.random.default_rng(3)
    views = tuple(
        replace(view, corners=view.corners + rng.normal(0, 5, view.corners.shape))
        for view in made.views
    )
    assert not outliers_of(calibrate(replace(made, views=views), FREE)).any()


def test_the_sentence() -> None:
    assert not describe_outlier_corners(None)
    assert describe_outlier_corners({"a": 1}) == (
        "1 corner of 1 view is pixels away from where neighbouring corners show it, and left out."
    )
