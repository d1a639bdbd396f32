"""The inner products against dense algebra, and the statistics against draws of a known
distribution.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.linalg import block_diag, null_space
from scipy.stats import chi2, kstest

from calib.checking.overdispersion import Overdispersion, explained_squares
from calib.checking.posterior_predictive import PosteriorPredictive, parameters_with_changes
from calib.checking.prior import CalibrationPrior
from calib.checking.significance import significance
from calib.effects.focal import Focal
from calib.estimation.observations import Observations
from calib.estimation.view_equations import view_equations
from calib.fitting.fit import fit
from calib.session.session import read_session
from fixtures.later import Later
from fixtures.synthetic import HEIGHT
from fixtures.wide import AngleLens
from tests.checking.conftest import Made

DRAWS = 300


def test_the_inner_products_agree_with_dense_algebra(cameras: Made) -> None:
    made, checker = cameras["flat"]
    later = Later.drawn(made, None, 5, 3)
    observations = Observations.of(later.views(), made.board).add_times(None, HEIGHT)
    poses, prior = later.made.poses, checker.prior
    changes = checker.changes[:2]
    predictive = PosteriorPredictive.of(prior, changes, observations, poses)
    parameters, new = parameters_with_changes(prior, changes)
    views = list(
        view_equations(
            prior.model.with_effects(new).path, parameters, observations, poses, prior.sigma
        )
    )
    complement = block_diag(
        *(null_space(view.jacobian_block.T).T for view in views)
    )  # all that no pose does
    residual = complement @ np.concatenate([view.residual for view in views])
    shared = complement @ np.concatenate([view.jacobian_shared for view in views])
    jacobian, columns = shared[:, : len(prior.root)] @ prior.root, shared[:, len(prior.root) :]
    covariance = np.eye(len(residual)) + jacobian @ jacobian.T
    rows = np.column_stack([residual, columns])
    dense = rows.T @ np.linalg.solve(covariance, rows)
    result = predictive.normalised_products()
    scale = np.sqrt(np.outer(dense.diagonal(), dense.diagonal()))
    assert np.abs((result - dense) / scale).max() < 1e-6  # the metric's condition is some 1e8
    assert predictive.freedom.sum() == len(residual)
    assert predictive.log_determinant(np.arange(3)) == pytest.approx(
        np.linalg.slogdet(covariance)[1], rel=1e-6
    )


def test_no_view_of_a_bare_camera_has_more_information_than_its_fit(tmp_path: Path) -> None:
    """The information of one view about the lens is a part of that of all views. A calibration
    without a cover keeps the latter as the covariance of its intrinsics, with correlations.
    """
    lens = AngleLens(140)
    session = read_session(lens.write_session(tmp_path / "session", lens.views(1, 10), "fisheye"))
    calibration = fit(session)
    prior = CalibrationPrior.of(calibration)
    poses = torch.from_numpy(calibration.poses)
    predictive = PosteriorPredictive.of(prior, (), calibration.observations, poses)
    inner = slice(1, 1 + predictive.calibrated)
    shares = [np.linalg.eigvalsh(products[inner, inner]) for products in predictive.products]
    assert predictive.calibrated == 8
    assert max(share.max() for share in shares) < 1
    assert np.sum(shares) == pytest.approx(8, rel=0.1), "the views' shares add up to the total"


def test_a_direction_that_moves_nothing_explains_nothing() -> None:
    """Rounding may even make its square negative."""
    products = np.array([[9.0, 2.0, 1e-3], [2.0, 4.0, 1e-3], [1e-3, 1e-3, -1e-12]])
    assert explained_squares(products, slice(1, 3)) == pytest.approx((1.0, 1))


def test_a_view_is_left_out_as_a_fit_without_it_would() -> None:
    """A linear problem with a prior, fitted with and without one of its views."""
    rng = np.random.default_rng(1)
    count, views, rows = 4, 5, 30
    jacobian, change = rng.normal(size=(views, rows, count)), rng.normal(size=(views, rows, 2))
    data, prior = rng.normal(size=(views, rows)), np.eye(count)

    def fitted(used: list[int]) -> tuple[np.ndarray, np.ndarray]:
        covariance = np.linalg.inv(prior + sum(jacobian[v].T @ jacobian[v] for v in used))
        return covariance, covariance @ sum(jacobian[v].T @ data[v] for v in used)

    covariance, estimate = fitted(list(range(views)))
    root = np.linalg.cholesky(covariance)
    columns = [
        np.column_stack([data[v] - jacobian[v] @ estimate, jacobian[v] @ root, change[v]])
        for v in range(views)
    ]
    predictive = PosteriorPredictive(
        np.array([view_columns.T @ view_columns for view_columns in columns]),
        np.full(views, float(rows)),
        count,
        {"it": slice(1 + count, 3 + count)},
        1.0,
    )
    for view in range(views):
        spread, without = fitted([v for v in range(views) if v != view])
        prediction_covariance = np.eye(rows) + jacobian[view] @ spread @ jacobian[view].T
        view_rows = np.column_stack([data[view] - jacobian[view] @ without, change[view]])
        result, freedom = predictive.leave_one_out(view)
        assert result == pytest.approx(
            view_rows.T @ np.linalg.solve(prediction_covariance, view_rows), rel=1e-9
        )
        assert freedom == rows


def test_every_column_is_computed(cameras: Made) -> None:
    """Changes may share a parameter. torch fills new memory with NaN here."""
    made, checker = cameras["flat"]
    later = Later.drawn(made, None, 5, 3)
    observations = Observations.of(later.views(), made.board).add_times(None, HEIGHT)
    parameters, new = parameters_with_changes(checker.prior, checker.changes)
    path = checker.prior.model.with_effects(new).path
    torch.use_deterministic_algorithms(True)
    try:
        views = list(
            view_equations(path, parameters, observations, later.made.poses, checker.prior.sigma)
        )
    finally:
        torch.use_deterministic_algorithms(False)
    assert np.isfinite(np.concatenate([view.jacobian_shared for view in views])).all()


def test_residuals_drawn_from_a_valid_calibration_give_uniform_p_values(cameras: Made) -> None:
    made, checker = cameras["dome"]
    later = Later.drawn(made, None, 6, 4)
    observations = Observations.of(later.views(), made.board).add_times(None, HEIGHT)
    prior, changes = checker.prior, checker.changes
    parameters, new = parameters_with_changes(prior, changes)
    views = list(
        view_equations(
            prior.model.with_effects(new).path,
            parameters,
            observations,
            later.made.poses,
            prior.sigma,
        )
    )
    predictive = PosteriorPredictive.of(prior, changes, observations, later.made.poses)
    columns = np.concatenate(
        [parameters.entries(u.param.name for u in change.effect_parameters) for change in changes]
    )
    bases = [null_space(view.jacobian_block.T).T for view in views]
    rows = [
        np.column_stack(
            [
                view.jacobian_shared[:, : len(prior.root)] @ prior.root,
                view.jacobian_shared[:, columns],
            ]
        )
        for view in views
    ]
    rows = [basis @ p_values for basis, p_values in zip(bases, rows, strict=True)]
    theory = Overdispersion(
        {c.name: 1.0 for c in changes},
        {c.name: np.inf for c in changes},
        {c.name: (0.0, 1.0) for c in changes},
        np.zeros(0),
    )
    rng = np.random.default_rng(2)
    tails: dict[str, list[float]] = {change.name: [] for change in changes}
    answers = []
    for _ in range(DRAWS):
        wrong = rng.normal(size=predictive.calibrated)
        drawn = [
            np.column_stack(
                [
                    rng.normal(size=len(p_values)) + p_values[:, : predictive.calibrated] @ wrong,
                    p_values,
                ]
            )
            for p_values in rows
        ]
        item = replace(predictive, products=np.array([p_values.T @ p_values for p_values in drawn]))
        together = item.normalised_products()
        for name, p_values in tails.items():
            square, directions = explained_squares(together, item.columns(name))
            p_values.append(float(chi2.sf(square, directions)))
        answers.append(significance(item, theory, 1.0))
    for name, p_values in tails.items():
        assert kstest(p_values, "uniform").pvalue > 1e-3, (
            name
        )  # one of some 14 is below 1e-3 in one of 70 runs; the draws are always the same
    assert (
        np.mean([answer.p_value < 0.1 for answer in answers]) < 0.1 + 3 * (0.1 * 0.9 / DRAWS) ** 0.5
    )
    assert np.mean([answer.statistic for answer in answers]) == pytest.approx(1.0, abs=0.02)


def test_a_change_is_measured_with_its_sign(cameras: Made) -> None:
    """To first order: minus the covariance times the score is what the focal length changed by."""
    made, checker = cameras["cone"]
    later = Later.drawn(made, Focal(), 7, 4)
    truth = float(later.direction["focal.change"]) / Focal().effect_parameters[0].param.scale
    observations = Observations.of(later.views(1, noise=0.0), made.board).add_times(None, HEIGHT)
    poses = later.made.poses
    predictive = PosteriorPredictive.of(checker.prior, (Focal(),), observations, poses)
    initial = PosteriorPredictive.of(
        checker.prior,
        (Focal(),),
        Observations.of(later.views(0, noise=0.0), made.board).add_times(None, HEIGHT),
        poses,
    )
    result = predictive.normalised_products()
    without_shift = initial.normalised_products()
    assert -(result[1, 0] - without_shift[1, 0]) / result[1, 1] == pytest.approx(truth, rel=0.1)
