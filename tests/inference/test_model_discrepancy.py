"""Structure of no cause, in each view another: how probable it makes the corners, against dense
algebra, and what it is told from.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.objective import view_precision
from calib.estimation.priors import Priors
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import LaplaceEvidence
from calib.inference.model_discrepancy import (
    LENGTHS,
    DiscrepancyLikelihood,
    board_modes,
    possible_gain,
)
from fixtures.synthetic import Scene, scene


def test_modes_have_the_processes_covariances() -> None:
    """On the grid of a board that is wider than high, some corners unseen: squared exponentials,
    but for the modes that are left out.
    """
    x, y = np.meshgrid(0.03 * np.arange(9), 0.03 * np.arange(6))
    corners = np.column_stack([x.ravel(), y.ravel()])[np.random.default_rng(0).permutation(54)[:40]]
    modes, spreads = board_modes(corners)
    distances = ((corners[:, None] - corners) ** 2).sum(-1) / np.ptp(corners, axis=0).max() ** 2
    for length, spread in zip(LENGTHS, spreads, strict=True):
        assert (
            np.abs(modes @ spread @ modes.T - np.exp(-distances / (2 * length**2))).max() < 0.03
        ), length  # a mode left out has a thousandth


def test_a_large_board_has_few_modes() -> None:
    """Time and memory are those of the lengths, and not of the corners."""
    x, y = np.meshgrid(np.arange(100.0), np.arange(100.0))
    assert board_modes(np.column_stack([x.ravel(), y.ravel()]))[0].shape[1] < 64


def test_points_on_no_grid_have_the_processes_covariances() -> None:
    """Decoded points of a screen share no coordinates: modes on some nodes are extended to them."""
    points = np.random.default_rng(0).uniform((-0.17, -0.1), (0.17, 0.1), (5000, 2))
    modes, spreads = board_modes(points)
    assert modes.shape[1] < 64
    some = points[:60]
    distances = ((some[:, None] - some) ** 2).sum(-1) / np.ptp(points, axis=0).max() ** 2
    for length, spread in zip(LENGTHS, spreads, strict=True):
        kernel = modes[:60] @ spread @ modes[:60].T
        assert np.abs(kernel - np.exp(-distances / (2 * length**2))).max() < 0.03


def test_the_likelihood_agrees_with_a_dense_one() -> None:
    """The test has three views with two own parameters, one of which has a prior, and two shared
    ones. Their dense covariance is written out, with a very wide prior for a flat one. The results
    differ by constants of the priors.
    """
    rng = np.random.default_rng(1)
    views, corners, modes = 3, 6, 4
    process, (own_jacobian, shared) = (
        rng.normal(size=(views, corners, modes)),
        (rng.normal(size=(views, 2 * corners, 2)) for _ in "ab"),
    )
    residuals_of_views = rng.normal(size=(views, 2 * corners, 1))
    roots = rng.normal(size=(2, modes, modes))
    spread = roots @ roots.swapaxes(1, 2)
    own_precision, precision = np.array([0.0, 2.0]), np.diag([3.0, 0.5])
    columns = torch.from_numpy(np.concatenate([own_jacobian, shared, residuals_of_views], -1))
    around = LaplaceEvidence(tuple(columns), torch.from_numpy(precision))
    likelihood = DiscrepancyLikelihood(
        around,
        torch.from_numpy(spread),
        list(torch.from_numpy(process)),
        torch.from_numpy(own_precision),
    )

    def dense(heights: tuple[float, float], noise: float) -> float:
        flat = 1e8
        covariance = np.kron(np.eye(views), noise**2 * np.eye(2 * corners))
        process_covariance = np.tensordot(np.square(heights), spread, 1)
        for view in range(views):
            place = slice(2 * view * corners, 2 * (view + 1) * corners)
            over_board = process[view] @ process_covariance @ process[view].T
            covariance[place, place] += noise**2 * np.kron(
                over_board, np.eye(2)
            )  # x and y have processes of their own
            covariance[place, place] += (
                own_jacobian[view] @ np.diag([flat, 0.5]) @ own_jacobian[view].T
            )
        stacked = shared.reshape(-1, 2)
        covariance += stacked @ np.linalg.inv(precision) @ stacked.T
        residual = residuals_of_views.ravel()
        return (
            -float(
                np.linalg.slogdet(covariance)[1] + residual @ np.linalg.solve(covariance, residual)
            )
            / 2
        )

    def log(heights: tuple[float, float], noise: float) -> float:
        return float(
            likelihood.log_evidence(
                torch.tensor(heights, dtype=torch.float64), torch.tensor(noise, dtype=torch.float64)
            )
        )

    for at in (((1.3, 0.0), 0.8), ((0.0, 0.0), 0.7), ((0.4, 2.0), 1.0)):
        assert log(*at) - log((0.0, 0.0), 1.0) == pytest.approx(
            dense(*at) - dense((0.0, 0.0), 1.0), abs=1e-3
        ), at


def optimum(made: Scene, shift: np.ndarray) -> FittedModel:
    """Return the fit of a camera whose focal lengths and glass are estimated, with its corners
    moved by (M, 2) px.
    """
    observations = made.observations
    moved = replace(observations, pixels=observations.pixels + torch.from_numpy(shift))
    model = CameraModel(made.path, made.values, Priors({"camera.fx": 20.0, "camera.fy": 20.0}))
    joint: JointFit = model.fit(moved, made.poses)
    assert joint.finite
    return FittedModel(model, moved, joint)


def gain(fitted: FittedModel) -> float:
    """Return the increase of the log evidence by a discrepancy that is possible."""
    observations = fitted.observations
    modes, spreads = board_modes(observations.corners.numpy())
    likelihood = DiscrepancyLikelihood(
        LaplaceEvidence.of(fitted),
        torch.from_numpy(spreads),
        [torch.from_numpy(view) for view in np.split(modes, observations.starts[1:-1].numpy())],
        view_precision(fitted.model.path, fitted.joint.poses),
    )
    heights, noise = likelihood.most_probable(), torch.ones(())
    largest = max(float(likelihood.log_evidence(heights, noise * factor)) for factor in (0.9, 1.0))
    return possible_gain(largest - float(likelihood.log_evidence(0 * heights, noise)))


def test_a_bend_in_each_view_raises_the_evidence_and_noise_does_not() -> None:
    made = scene(5, views=12, grid=(4, 4), noise=0.1)
    corners, view = made.observations.corners.numpy(), made.observations.view.numpy()
    assert abs(gain(optimum(made, np.zeros((len(corners), 2))))) < 0.1
    waves = np.random.default_rng(2).normal(0, 0.2, (made.poses.shape[0], 2))
    u = corners / np.abs(corners).max(0)
    bent = waves[view] * (np.sin(3 * u[:, :1]) * np.cos(2 * u[:, 1:]))
    assert gain(optimum(made, bent)) > 100  # 0.07 px of it beside 0.1 px of noise
