"""The formulas of docs/mathematics.md are those of the code."""

import numpy as np
import pytest
import torch

from calib.estimation.noise import short_scale_noise
from calib.estimation.surface_prior import MarginalLikelihood, Quadratic
from calib.inference.view_scatter import ViewScatter, WhitenedRows
from calib.optics.cone import Cone
from calib.optics.relief import Relief
from calib.optics.snell import Refraction
from calib.optics.vector import Vector
from calib.session.board import Board


def number(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def test_a_ray_meets_the_cone_where_the_page_says() -> None:
    radius, slope, height = 0.043, -0.105, 0.003
    o, r = np.array([0.002, -0.004, 0.03]), np.array([0.3, 0.2, 0.93])
    r /= np.linalg.norm(r)
    values = {"cover.inner_radius": number(radius), "cover.radius_slope": number(slope)}
    result, miss = Cone().reach(
        Vector(*map(number, o)), Vector(*map(number, r)), number(height), values
    )
    rho = radius + height + slope * o[1]
    a = r[0] ** 2 + r[2] ** 2 - (slope * r[1]) ** 2
    b = o[0] * r[0] + o[2] * r[2] - slope * r[1] * rho
    c = o[0] ** 2 + o[2] ** 2 - rho**2
    assert not miss
    assert float(result) == pytest.approx(-c / (b + np.sqrt(b**2 - a * c)), rel=1e-12)


def test_a_ray_is_bent_as_the_page_says() -> None:
    r, n = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.0, 1.0])
    direction = Refraction.of(
        Vector(*map(number, r)), Vector(*map(number, n)), number(1 / 1.5)
    ).bent
    mu = 1 / 1.5
    alpha = r @ n
    beta = np.sqrt(1 - mu**2 * (1 - alpha**2))
    expected = mu * r + (beta - mu * alpha) * n
    assert direction.stacked().numpy() == pytest.approx(expected, abs=1e-15)
    assert np.arcsin(expected[0]) == pytest.approx(np.arcsin(r[0] / 1.5), rel=1e-12)


def test_the_glass_is_the_sum_page_evidence() -> None:
    relief = Relief((0.0, -1.0), (0.02, 1.0), (3, 5))
    rng = np.random.default_rng(0)
    amplitudes = rng.normal(size=(3, 5))
    s = np.array([0.013, 0.2])
    values = {"relief.amplitudes": torch.from_numpy(amplitudes)}
    result = float(relief.height((number(s[0]), number(s[1])), values)[0])
    centres = np.stack(
        np.meshgrid(np.linspace(0, 0.02, 3), np.linspace(-1, 1, 5), indexing="ij"), -1
    )
    offsets = (s - centres) / [0.01, 0.5]
    assert result == pytest.approx(
        float((amplitudes * np.exp(-(offsets**2).sum(-1) / 2)).sum()), rel=1e-12
    )


def test_the_noise_is_that_page_evidence() -> None:
    board = Board(9, 7, 0.02)
    residuals = np.random.default_rng(0).normal(size=(4, 7, 9, 2))
    horizontal = residuals[:, :, 1:-1] - (residuals[:, :, :-2] + residuals[:, :, 2:]) / 2
    vertical = residuals[:, 1:-1] - (residuals[:, :-2] + residuals[:, 2:]) / 2
    differences = np.abs(np.concatenate([horizontal.ravel(), vertical.ravel()]))
    expected = 2**0.5 * 1.4826 * np.median(differences) / 1.5**0.5
    result = short_scale_noise(residuals.reshape(4, 63, 2), board)
    assert result == pytest.approx(expected, rel=1e-9)


def test_the_evidence_is_that_page_evidence() -> None:
    """Up to the constant, so differences are compared."""
    rng = np.random.default_rng(0)
    jacobian, residual = rng.normal(size=(40, 3)), rng.normal(size=40)
    root = np.linalg.cholesky(np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 0.5]]))
    freedom = 34

    def page_evidence(sigma: float, root: np.ndarray) -> float:
        jacobian_e, e = jacobian / sigma, residual / sigma
        precision = np.linalg.inv(root @ root.T)
        best = np.linalg.solve(jacobian_e.T @ jacobian_e + precision, jacobian_e.T @ e)
        lowest = float(((e - jacobian_e @ best) ** 2).sum() + best @ precision @ best)
        sign, log_det = np.linalg.slogdet(np.eye(3) + root.T @ jacobian_e.T @ jacobian_e @ root)
        assert sign > 0
        return float(-log_det / 2 - lowest / 2 - freedom * np.log(sigma))

    quadratic = Quadratic(
        jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), freedom
    )
    for sigma, factor in ((0.7, 1.0), (1.3, 1.0), (1.0, 3.0)):
        result = MarginalLikelihood(quadratic, None, factor * root).log(sigma, None)
        result -= MarginalLikelihood(quadratic, None, root).log(1.0, None)
        expected = page_evidence(sigma, factor * root) - page_evidence(1.0, root)
        assert result == pytest.approx(expected, abs=1e-9)


def test_the_scatter_of_the_views_is_that_page_evidence() -> None:
    rng = np.random.default_rng(0)
    jacobians, residuals = rng.normal(size=(10, 30, 3)), rng.normal(size=(10, 30))
    covariance = np.linalg.inv(sum(j.T @ j for j in jacobians) + np.eye(3))
    root = np.linalg.cholesky(covariance)
    squares, leverages = 0.0, 0.0
    for jacobian, residual in zip(jacobians, residuals, strict=True):
        leverage = root.T @ jacobian.T @ jacobian @ root
        sizes, axes = np.linalg.eigh(np.eye(3) - leverage)
        pull = (axes / np.sqrt(sizes)) @ axes.T @ root.T @ jacobian.T @ residual
        squares += float(pull @ pull)
        leverages += float(np.trace(leverage))
    groups = (WhitenedRows(j @ root, e) for j, e in zip(jacobians, residuals, strict=True))
    scatter = ViewScatter.of_groups(groups, root)
    assert scatter.ratio**2 == pytest.approx(squares / leverages, rel=1e-9)
