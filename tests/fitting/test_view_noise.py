"""Views whose corners scatter more than those of other views weigh less; views with a large but
smooth residual do not.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.calibration import Calibration
from calib.cli import main
from calib.corners.view import View
from calib.estimation.noise import noise_of_views
from calib.estimation.residuals import Residuals
from calib.fit_record.request import Settings
from calib.fitting.view_noise import describe_noisy_views, weigh_noisy_views
from calib.session.board import Board
from fixtures.calibrated import GLASS, calibrate
from fixtures.map_errors import errors
from fixtures.synthetic import Scene, scene
from tests.test_calibration import write_session

NOISE = 0.1  # px


def with_noisier_views(made: Scene, times: float, numbers: Sequence[int]) -> Scene:
    """Return the scene with `times` the noise in the views of these numbers."""
    rng = np.random.default_rng(4)
    extra = NOISE * np.sqrt(times**2 - 1)
    views = (
        (
            replace(view, corners=view.corners + rng.normal(0, extra, view.corners.shape))
            if index in numbers
            else view
        )
        for index, view in enumerate(made.views)
    )
    return replace(made, views=tuple(views))


def weigh_residuals(made: Scene, errors: np.ndarray) -> tuple[tuple[View, ...], dict[str, float]]:
    """Weigh the views by the (V, corners, 2) px residuals of a fit."""
    image = torch.from_numpy(errors.reshape(-1, 2))
    return weigh_noisy_views(made.views, made.observations, Residuals(image, image), made.board)


@pytest.mark.parametrize("board", [Board(9, 9, 0.02), Board(7, 5, 0.02), Board(4, 3, 0.02)])
def test_a_view_s_noise_and_its_spread_are_the_simulated_ones(board: Board) -> None:
    drawn = np.random.default_rng(1).normal(0, NOISE, (3000, board.count, 2))
    noise, spread = noise_of_views(drawn, board)
    assert np.median(noise) == pytest.approx(2**0.5 * NOISE, rel=0.03)
    assert noise.std() / np.median(noise) == pytest.approx(
        spread[0], rel=0.15
    )  # the constant is one for all boards


def test_no_view_is_noisy_among_alike_views() -> None:
    made = scene(1, 20, noise=0.0)
    for seed in range(50):  # a thousand views
        drawn = np.random.default_rng(seed).normal(0, NOISE, (20, 81, 2))
        views, noise_ratios = weigh_residuals(made, drawn)
        assert not noise_ratios
        assert views == made.views


def test_a_view_with_a_common_shift_is_not_noisy() -> None:
    """A board that bends otherwise in one view leaves a hundred times the noise there, and its
    corners scatter as all others do.
    """
    made = scene(1, 20, noise=0.0)
    drawn = np.random.default_rng(2).normal(0, NOISE, (20, 81, 2))
    x, y = made.board.points().T / 0.08
    drawn[3] += 100 * NOISE * np.column_stack([x**2 - y**2, x * y**2])
    assert not weigh_residuals(made, drawn)[1]
    drawn[5] *= 3
    assert weigh_residuals(made, drawn)[1] == {"0005.png": pytest.approx(3, rel=0.2)}


def test_corners_with_a_smaller_weight_are_not_counted_twice() -> None:
    made = scene(1, 20, noise=0.0)
    views = [
        replace(view, weight=view.weight / 3) if index == 5 else view
        for index, view in enumerate(made.views)
    ]
    drawn = np.random.default_rng(2).normal(0, NOISE, (20, 81, 2))
    drawn[5] *= 3
    assert not weigh_residuals(replace(made, views=tuple(views)), drawn)[1]


@pytest.mark.slow
def test_weighing_noisy_views_less_improves_maps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight of twenty views are six times worse: with equal weights these decide."""
    made = with_noisier_views(
        scene(72_001, 20, amplitude=1e-5, noise=NOISE, cover=GLASS), 6, range(8)
    )

    def far_off(calibration: Calibration) -> tuple[float, float]:
        error, sigma = map(np.concatenate, zip(*errors(made, calibration), strict=True))
        return float(np.sqrt((error**2).mean())), float(np.sqrt((sigma**2).mean()))

    ours = calibrate(made, Settings())
    assert set(ours.outcome.view_noise or ()) == {f"{index:04}.png" for index in range(8)}
    monkeypatch.setattr("fixtures.calibrated.weigh_noisy_views", lambda views, *_: (views, {}))
    alike = calibrate(made, Settings())
    assert not alike.outcome.view_noise
    (better, sure), (poor, unsure) = far_off(ours), far_off(alike)
    assert better < 0.6 * poor
    assert sure < 0.6 * unsure
    assert better < 2 * sure


@pytest.mark.slow
def test_a_fit_reports_and_saves_the_views_with_less_weight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = with_noisier_views(scene(8, 12, noise=NOISE), 4, [2, 7])
    place = write_session(tmp_path / "s", made)
    assert main(["fit", str(place), "--free", "none", "--grid", "5x4", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)["view_noise"]
    assert answer.keys() == {"0002.png", "0007.png"}
    assert all(times == pytest.approx(4, rel=0.25) for times in answer.values())
    back = Calibration.load(place / "calibration")
    assert back.outcome.view_noise == answer
    weights = {view.name: float(view.weight.max()) for view in back.views}
    assert {name for name, weight in weights.items() if weight < 1} == answer.keys()
    assert (
        "times as large, so it weighs less" in (place / "calibration" / "report.html").read_text()
    )
    assert main(["fit", str(place), "--free", "none", "--grid", "5x4"]) == 0
    assert "2 views are noisier than the others, and weigh less: 000" in capsys.readouterr().out


def test_the_papers_procedure_weighs_all_views_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = write_session(tmp_path / "s", with_noisier_views(scene(8, 12, noise=NOISE), 4, [2, 7]))
    assert (
        main(["fit", str(place), "--method", "paper", "--steps", "20", "--grid", "5x4", "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["view_noise"] == {}


def test_the_sentence() -> None:
    assert not describe_noisy_views({})
    assert (
        describe_noisy_views({"a": 2.04})
        == "1 view is noisier than the others, and weighs less: a (2.0 times)."
    )
    assert describe_noisy_views(dict.fromkeys("abcde", 2.0)).endswith(
        " weigh less: a (2.0 times), b (2.0 times), c (2.0 times) and 2 more."
    )
