"""Structure of no cause, in each view another: how probable it makes the corners, against dense algebra, and what it is told from."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.diagnosis.score_test import Optimum
from calib.diagnosis.unnamed_structure import Likelihood, gain, modes_of
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.priors import Priors
from fixtures.synthetic import Scene, scene

LENGTH, HEIGHT, NOISE = 0.3, 1.3, 0.8


def test_modes_have_the_process_s_covariance() -> None:
    """On the grid of a board that is wider than high, some corners unseen: a squared exponential, but for the modes that are left out."""
    x, y = np.meshgrid(0.03 * np.arange(9), 0.03 * np.arange(6))
    corners = np.column_stack([x.ravel(), y.ravel()])[np.random.default_rng(0).permutation(54)[:40]]
    modes = modes_of(corners, LENGTH)
    apart = ((corners[:, None] - corners) ** 2).sum(-1) / (LENGTH * np.ptp(corners, axis=0).max()) ** 2
    assert np.abs(modes @ modes.T - np.exp(-apart / 2)).max() < 0.02  # a mode that is left out has a thousandth of the largest's variance


def test_the_likelihood_is_the_dense_one() -> None:
    """Of three views with two own parameters, one of which has a prior, and two shared ones: a normal distribution whose covariance is
    written out, a flat prior being a very wide one. Only constants differ, those of the priors."""
    rng = np.random.default_rng(1)
    views, rows, modes = 3, 12, 4
    process, own, shared = (rng.normal(size=(views, rows, count)) for count in (modes, 2, 2))
    left = rng.normal(size=(views, rows, 1))
    own_precision, precision = np.array([0.0, 2.0]), np.diag([3.0, 0.5])
    columns = torch.from_numpy(np.concatenate([process, own, shared, left], -1))
    products = columns.mT @ columns
    likelihood = Likelihood(products, modes, torch.from_numpy(own_precision), torch.from_numpy(precision), views * rows)

    def dense(height: float, noise: float) -> float:
        flat = 1e8
        covariance = np.kron(np.eye(views), noise**2 * np.eye(rows))
        for view in range(views):
            place = slice(view * rows, (view + 1) * rows)
            covariance[place, place] += noise**2 * height**2 * process[view] @ process[view].T
            covariance[place, place] += own[view] @ np.diag([flat, 0.5]) @ own[view].T
        whole = shared.reshape(-1, 2)
        covariance += whole @ np.linalg.inv(precision) @ whole.T
        residual = left.ravel()
        return -float(np.linalg.slogdet(covariance)[1] + residual @ np.linalg.solve(covariance, residual)) / 2

    for at in ((HEIGHT, NOISE), (0.0, 0.7), (0.4, 1.0)):
        told = likelihood.log(*at) - likelihood.log(0.0, 1.0)
        assert told == pytest.approx(dense(*at) - dense(0.0, 1.0), abs=1e-3), at


def optimum(made: Scene, shift: np.ndarray) -> Optimum:
    """Of a camera whose focal lengths and glass are estimated, its corners moved by (M, 2) px."""
    seen = made.observations
    moved = replace(seen, pixels=seen.pixels + torch.from_numpy(shift))
    model = CameraModel(made.path, made.values, Priors({"camera.fx": 20.0, "camera.fy": 20.0}))
    joint: JointFit = model.fitted(moved, made.poses)
    assert joint.finite
    return Optimum(model, moved, joint)


def test_noise_has_no_structure_and_a_bend_of_its_own_in_each_view_has() -> None:
    made = scene(5, views=12, grid=(4, 4), noise=0.1)
    corners, view = made.observations.corners.numpy(), made.observations.view.numpy()
    assert gain(optimum(made, np.zeros((len(corners), 2)))) < 3  # of a likelihood that has two more numbers, and three lengths
    waves = np.random.default_rng(2).normal(0, 0.2, (made.poses.shape[0], 2))
    u = corners / np.abs(corners).max(0)
    bent = waves[view] * (np.sin(3 * u[:, :1]) * np.cos(2 * u[:, 1:]))
    assert gain(optimum(made, bent)) > 100  # 0.07 px of it beside 0.1 px of noise
