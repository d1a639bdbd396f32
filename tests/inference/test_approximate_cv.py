"""Fits without some views, from the fit to all: where fits of the others end, by a step or, where
that fails, by fitting them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.effects.board_shape import BoardShape
from calib.estimation.joint_fit import ROUNDS, Estimate, JointFit
from calib.estimation.residuals import residuals
from calib.inference.approximate_cv import FitWithout, fits_without
from calib.inference.calibration_model import base_model
from calib.inference.fitted_model import FittedModel
from tests.diagnosis.hide import fitted, hidden

PARTS = np.arange(12) % 3


@pytest.fixture(scope="module")
def optimum() -> FittedModel:
    """A bowed board behind uneven glass, and its effect in the model."""
    shape = BoardShape(0.08, 0.08)
    made = fitted(
        hidden(
            shape,
            {"board_shape.xx": 6e-4, "board_shape.xy": 3e-4, "board_shape.yy": -4e-4},
            views=12,
        )
    )
    model = base_model(made).with_effect(shape)
    return FittedModel(
        model,
        made.observations,
        model.fit(made.observations, torch.from_numpy(made.poses), None, ROUNDS),
    )


def cost_of(optimum: FittedModel) -> float:
    """Return the minimum of the fit."""
    assert isinstance(optimum.joint, JointFit)
    return optimum.joint.cost


def apart(at: FittedModel, estimate: Estimate, reference: Estimate) -> float:
    """The largest difference of two fits' numbers, over the sigma of the other."""
    vectors = [at.model.parameters.vector(joint.values) for joint in (estimate, reference)]
    return float(((vectors[0] - vectors[1]) / reference.covariance.diagonal().sqrt()).abs().max())


def test_one_step_reaches_the_fit_of_the_remaining_views(optimum: FittedModel) -> None:
    for index, without in enumerate(fits_without(optimum, cost_of(optimum), PARTS)):
        fit, out = without.joint, torch.from_numpy(index == PARTS)
        refit = optimum.model.fit(
            optimum.observations.without_views(out), optimum.joint.poses[~out], optimum.joint.start
        )
        assert apart(optimum, fit, refit) < 0.1 < apart(optimum, optimum.joint, refit)
        assert torch.allclose(fit.covariance.diagonal(), refit.covariance.diagonal(), rtol=0.02)
        moved = float((optimum.joint.poses[~out] - refit.poses).abs().max())
        missing = float((fit.poses[~out] - refit.poses).abs().max())
        assert missing < 0.1 * moved


@pytest.mark.parametrize("interval", [1, 2])
def test_poses_of_held_out_views_follow_by_one_step(optimum: FittedModel, interval: int) -> None:
    """The residual of held-out views by the equations is that of fits of their poses to all of
    their corners, or to every other corner.
    """
    pose_corners = torch.arange(len(optimum.observations.pixels)) % interval == 0
    for index, fit in enumerate(fits_without(optimum, cost_of(optimum), PARTS, pose_corners)):
        out = torch.from_numpy(index == PARTS)
        test = optimum.observations.without_views(~out)
        stay = optimum.joint.poses[out]
        poses = optimum.model.fit_poses(
            fit.joint, test.select_rows(pose_corners[out[optimum.observations.view]]), stay
        )
        residual = residuals(optimum.model.path, fit.joint.values, test, poses).image
        initial_residual = residuals(optimum.model.path, fit.joint.values, test, stay).image
        error = float((fit.residual - residual).square().mean().sqrt())
        control = float((initial_residual - residual).square().mean().sqrt())
        assert error < 0.07 * optimum.joint.sigma, "a two-hundredth of its square"
        assert error < 0.25 * control


@pytest.mark.slow
def test_the_prediction_variance_equals_the_scatter_over_drawn_parameters(
    optimum: FittedModel,
) -> None:
    """The parameters are drawn from their covariance, and the views' poses follow."""
    fit = fits_without(optimum, cost_of(optimum), PARTS)[0]
    out = torch.from_numpy(PARTS == 0)
    test = optimum.observations.without_views(~out)
    root = torch.linalg.cholesky(fit.joint.covariance)
    middle = optimum.model.parameters.vector(fit.joint.values)
    rng = torch.Generator().manual_seed(0)
    drawn = []
    for _ in range(40):
        values = optimum.model.parameters.values(
            middle + root @ torch.randn(len(root), dtype=torch.float64, generator=rng)
        )
        poses = optimum.model.fit_poses(
            replace(fit.joint, values=values), test, fit.joint.poses[out]
        )
        drawn.append(residuals(optimum.model.path, values, test, poses).image - fit.residual)
    variance = torch.stack(drawn).square().mean((0, 2)) / optimum.joint.sigma**2
    assert float(variance.mean() / fit.prediction_variance.mean()) == pytest.approx(
        1, abs=0.3
    )  # 40 draws of some ten directions
    assert (
        float(torch.corrcoef(torch.stack([variance.log(), fit.prediction_variance.log()]))[0, 1])
        > 0.9
    )


def test_the_remaining_views_are_fitted_if_a_step_fails(
    optimum: FittedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From boards that are turned by 30 degrees, equations say little of where the fit ends."""
    turned = optimum.joint.poses + torch.tensor([0.5, 0, 0, 0, 0, 0], dtype=torch.float64)
    astray = replace(optimum, joint=replace(optimum.joint, poses=turned))
    assert all(
        error < 1.01 for error in errors(optimum, fits_without(astray, cost_of(optimum), PARTS))
    )
    monkeypatch.setattr("calib.inference.approximate_cv.TOLERANCE", float("inf"))
    assert all(
        error > 2 for error in errors(optimum, fits_without(astray, cost_of(optimum), PARTS))
    ), "the control: the steps alone"


def errors(at: FittedModel, fits: Sequence[FitWithout]) -> Iterator[float]:
    """Yield the error of each fit on its own views over the error of the fit to all views."""
    for index, fit in enumerate(fits):
        out = torch.from_numpy(index == PARTS)
        observations = at.observations.without_views(out)
        rms = residuals(at.model.path, fit.joint.values, observations, fit.joint.poses[~out]).rms_px
        full_rms = residuals(
            at.model.path, at.joint.values, observations, at.joint.poses[~out]
        ).rms_px
        yield rms / full_rms
