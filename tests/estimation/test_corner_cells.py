"""A part of very many corners, their averages, and fits that start there."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.effects.board_scale import DEGREES, BoardScale
from calib.estimation import corner_cells
from calib.estimation.corner_cells import average_corners, is_large, part_rows, spread_part
from calib.estimation.joint_fit import JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.residuals import residuals
from calib.fit_record.request import Settings
from calib.fitting import fit_job
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import score_tests
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, paper_cone, scene

VIEWS, SIDE = 16, 25
FEW_CELLS = 10 * 10 * VIEWS


@pytest.fixture(scope="module")
def made() -> Scene:
    board = Board(SIDE, SIDE, 0.16 / (SIDE - 1))
    return scene(1, VIEWS, noise=0.1, board=board, cover=paper_cone(), depths=(0.35, 1.2))


def fitted_with(made: Scene, cells: int, tolerance: float) -> Fitted:
    """The fit of a scene as if this number of cells were many."""
    settings = Settings(grid=(8, 8))
    camera = Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS)
    setup = Setup(made.board, camera, INTRINSICS, made.cover).with_tolerances(settings)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(corner_cells, "CELLS", cells)
        patch.setattr(fit_job, "LAST_ROUNDS", (fit_job.LAST_ROUNDS[0], tolerance))
        return fit_stages(setup, made.observations, settings, Silent())


@pytest.fixture(scope="module")
def fit_to_all(made: Scene) -> Fitted:
    """The fit of all corners from the start."""
    return fitted_with(made, 10**6, 1e-6)


@pytest.fixture
def few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corner_cells, "CELLS", FEW_CELLS)


def deviation(first: JointFit, second: JointFit) -> float:
    """The largest difference of two fits' numbers, over their standard deviations."""
    change = first.parameters.vector(first.values) - second.parameters.vector(second.values)
    return float((change.abs() / first.covariance.diagonal().sqrt()).max())


def test_a_usual_session_is_fitted_as_a_whole(made: Scene) -> None:
    observations = made.observations
    assert not is_large(observations)
    assert spread_part(observations) is observations
    assert fitted_with(made, 10**6, 1e-6).on_averages is None


@pytest.mark.usefixtures("few_cells")
def test_a_part_is_spread_evenly_over_each_board(made: Scene) -> None:
    corners = spread_part(made.observations)
    assert corners.starts.diff().tolist() == [100] * VIEWS
    for places in corners.per_view(corners.corners):
        fifth = ((places / made.board.half[0] + 1) * 2.5).long().clamp(0, 4)
        counts = torch.bincount(5 * fifth[:, 0] + fifth[:, 1], minlength=25)
        assert (counts == 4).all()


@pytest.mark.usefixtures("few_cells")
def test_a_view_with_few_corners_keeps_them(made: Scene) -> None:
    """The cells of a view cover its own corners, not the whole board."""
    observations = made.observations
    rows = torch.ones(len(observations.pixels), dtype=torch.bool)
    is_close = (observations.corners - observations.corners[0]).norm(dim=-1) < 0.025
    first_view = observations.view == 0
    rows[first_view] = is_close[first_view]
    observations = observations.select_rows(rows)
    rows = part_rows(observations)[observations.view == 0]
    assert rows.sum() > 0.5 * len(rows)


@pytest.mark.usefixtures("few_cells")
def test_averages_keep_what_the_corners_tell(made: Scene, fit_to_all: Fitted) -> None:
    """The oracle is the normal equations and a score test of all corners. Ten cells along a side
    lose a hundredth of what is linear over the board, a tenth of a bump of the glass, and a seventh
    of an error of the print that follows a cubic.
    """
    assert fit_to_all.model
    assert fit_to_all.joint
    full = FittedModel(fit_to_all.model, made.observations, fit_to_all.joint)
    averages = full.averaged()
    assert len(averages.observations.pixels) == 100 * VIEWS
    assert averages.observations.residual_count == made.observations.residual_count
    total = full.information().sum(0)
    total_of_averages = averages.information().sum(0)
    scale = np.sqrt(np.diag(total))
    assert np.abs((total_of_averages - total) / np.outer(scale, scale)).max() < 0.1
    half = made.board.half
    corners = made.observations.corners
    stretched = corners * (1 + 1e-3 * (corners[:, :1] / half[0]) ** 2)
    on_other_print = replace(full, observations=replace(made.observations, corners=stretched))
    stretch = BoardScale(True, DEGREES[-1], half)
    test = score_tests(on_other_print, [stretch])[0]
    test_of_averages = score_tests(on_other_print.averaged(), [stretch])[0]
    assert test.chi2 > 100
    assert 0.8 < test_of_averages.chi2 / test.chi2 < 1.01
    assert test_of_averages.cost == pytest.approx(test.cost, rel=0.01)


@pytest.mark.usefixtures("few_cells")
def test_averages_are_free_of_curvature(made: Scene, fit_to_all: Fitted) -> None:
    """Averages of corners that the model explains exactly are explained exactly."""
    assert fit_to_all.joint
    path, values, poses = fit_to_all.path, fit_to_all.values, fit_to_all.poses
    image = residuals(path, values, made.observations, poses).image
    exact = replace(made.observations, pixels=made.observations.pixels + image)
    averages = average_corners(path, values, exact, poses, fit_to_all.joint.sigma)
    assert residuals(path, values, averages, poses).rms_px < 1e-6
    assert averages.merged_squares < 1e-9


def test_a_part_of_the_corners_leads_to_the_same_optimum(made: Scene, fit_to_all: Fitted) -> None:
    """Both fits are taken to their ends with the same noise and prior: what a part finds, all
    corners would find. With its own noise and prior, and where a fit usually ends, a number differs
    by a hundredth of its standard deviation.
    """
    fitted = fitted_with(made, FEW_CELLS, 1e-13)
    assert fitted.on_averages
    assert fitted.joint
    assert fitted.joint.outcome is Outcome.CONVERGED
    assert fit_to_all.joint
    assert fit_to_all.model
    start = replace(
        fit_to_all.joint.start, sigma=fitted.joint.sigma, smoothness=fitted.joint.smoothness
    )
    end = fit_to_all.model.fit(made.observations, fit_to_all.poses, start, (1e-13,))
    end = fit_to_all.model.fit(made.observations, end.poses, end.start, (1e-13,))
    assert deviation(end, fitted.joint) < 3e-4
    assert fitted.joint.sigma == pytest.approx(fit_to_all.joint.sigma, rel=1e-4)
    usual_fit = fitted_with(made, FEW_CELLS, 1e-6)
    assert usual_fit.joint
    assert deviation(fit_to_all.joint, usual_fit.joint) < 0.03
