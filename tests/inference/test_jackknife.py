"""The jackknife of a score, on views of which only some say anything."""

import numpy as np

from calib.inference.jackknife import jackknife_p_value

VIEWS, ROWS, PARAMETERS = 12, 80, 3


def _p_value(size: float, seed: int, *, silent: int = 0, bad: int = 0) -> float:
    """Return the p-value of an effect that shifts a view's rows by `size` sigma and more. The first
    views do not show it, and the last ones have noise of five sigma.
    """
    rng = np.random.default_rng(seed)
    rows = [
        rng.normal(0, 0.0 if view < silent else 1.0, (ROWS, PARAMETERS)) for view in range(VIEWS)
    ]
    sigmas = [5.0 if view >= VIEWS - bad else 1.0 for view in range(VIEWS)]
    residuals = [
        row @ np.full(PARAMETERS, size) + rng.normal(0, sigma, ROWS)
        for row, sigma in zip(rows, sigmas, strict=True)
    ]
    score = sum(row.T @ residual for row, residual in zip(rows, residuals, strict=True))
    return jackknife_p_value(
        residuals, rows, score, sum(row.T @ row for row in rows) + np.eye(PARAMETERS)
    )


def test_an_effect_is_detected_beside_uninformative_and_bad_views() -> None:
    """Nine or ten views of twelve agree: flips of their signs alone are as one-sided once in 2^9
    times, twice that for two tests.
    """
    assert _p_value(1.0, 0) < 1e-3
    assert _p_value(1.0, 0, silent=2) < 0.01
    assert _p_value(1.0, 0, bad=2) < 0.01


def test_noise_passes_at_most_at_the_stated_rate() -> None:
    p_values = np.array([_p_value(0.0, seed) for seed in range(100)])
    assert (p_values < 0.05).sum() <= 10  # 5 are expected at most, their standard deviation is 2.2
