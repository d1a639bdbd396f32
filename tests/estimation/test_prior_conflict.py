"""Numbers that the views contradict."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.estimation.prior_conflict import PRIOR_INFLATION, log_odds_of_swap
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.session.schema import Number
from fixtures.calibrated import CAMERA, tolerant
from fixtures.synthetic import INTRINSICS, Scene, scene


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(3, views=20, noise=0.02)


def test_a_wrongly_declared_number_is_found(made: Scene) -> None:
    wrong = replace(made.cover, parameters={**made.cover.parameters, "thickness": Number(0.006)})
    resolved = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, wrong), Settings(grid=(6, 6)))
    assert resolved.declared.doubted == ("cover.thickness",)
    assert resolved.declared.cover.parameters["thickness"] == Number(0.006, 5e-4), (
        "what was declared is kept"
    )
    estimate = resolved.cover.parameters["thickness"]
    assert abs(estimate.value - 0.003) < 3 * estimate.sigma
    assert estimate.sigma < 5e-4, "it is the views that tell"


def test_true_numbers_do_not_conflict(made: Scene) -> None:
    resolved = tolerant(
        made, Setup(made.board, CAMERA, INTRINSICS, made.cover), Settings(grid=(6, 6))
    )
    assert resolved.declared.doubted == ()
    for name, number in resolved.cover.parameters.items():
        assert abs(number.value - made.cover.parameters[name].value) <= 3.5 * number.sigma, name


def test_the_odds_of_a_swap_are_those_of_the_two_evidences() -> None:
    """Oracle: a linear model, of which the evidence with either prior is a normal density."""
    rng = np.random.default_rng(3)
    design, noise = rng.normal(size=(6, 2)), 0.3
    tolerances = np.array([0.5, 0.7])
    rows = design @ [3.0, 0.4] + noise * rng.normal(size=6)
    wide = tolerances * [PRIOR_INFLATION, 1], tolerances * [1, PRIOR_INFLATION]
    evidences = [
        multivariate_normal.logpdf(
            rows, cov=design @ np.diag(sigmas**2) @ design.T + noise**2 * np.eye(6)
        )
        for sigmas in wide
    ]
    precision = design.T @ design / noise**2 + np.diag(wide[0] ** -2.0)
    covariance = np.linalg.inv(precision)
    estimate = covariance @ design.T @ rows / noise**2
    odds = log_odds_of_swap(estimate, covariance, tolerances)
    assert odds == pytest.approx(evidences[1] - evidences[0], abs=1e-9)
