"""The scale of a field without a name, by evidence."""

import numpy as np
import pytest
from scipy.stats import Covariance, multivariate_normal

from calib.effects.cosine_field import KNEES, SIZE_FACTORS, WAVES
from calib.effects.free_field import FreeField

FIELD = FreeField((-0.1, -0.1), (0.1, 0.1), FreeField.first_size, 2.0)
SCALE = FIELD.effect_parameters[0].param.scale
ROWS = 600


def falls(knee: float) -> np.ndarray:
    """Return the fall of both directions' numbers, as the page states it."""
    m, n = np.meshgrid(np.arange(WAVES), np.arange(WAVES), indexing="ij")
    return np.tile(1 / (1 + (m**2 + n**2) / knee**2).ravel(), 2)


def observed(size: float, knee: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(ROWS, 162) what FIELD's numbers over their scales do, and (ROWS,) what a field of another
    scale left, with noise of 1.
    """
    rng = np.random.default_rng(seed)
    columns = rng.normal(0, 0.05, (ROWS, 2 * WAVES**2))
    parameters = rng.normal(0, size / SCALE, 2 * WAVES**2) * falls(knee) / falls(FIELD.knee)
    return columns, columns @ parameters + rng.normal(0, 1, ROWS)


def test_the_evidence_is_the_residual_s_probability() -> None:
    """The chosen scale is that of the largest density of the residual, which scipy's normal
    distribution gives without any algebra.
    """
    columns, residual = observed(2e-4, 4.0, seed=1)

    def density(size: float, knee: float) -> float:
        spread = columns * (size / SCALE * falls(knee) / falls(FIELD.knee))
        covariance = Covariance.from_cholesky(np.linalg.cholesky(np.eye(ROWS) + spread @ spread.T))
        return float(multivariate_normal.logpdf(residual, np.zeros(ROWS), covariance))

    best = max(
        ((FreeField.first_size * factor, knee) for factor in SIZE_FACTORS for knee in KNEES),
        key=lambda scale: density(*scale),
    )
    chosen = FIELD.tune(columns.T @ columns, columns.T @ residual)
    assert (chosen.size, chosen.knee) == best


@pytest.mark.parametrize(("size", "knee"), [(2e-5, 1.0), (2e-4, 2.0), (1e-3, 8.0)])
def test_scales_that_made_the_field_are_found_again(size: float, knee: float) -> None:
    """The nearest of those that are asked, a factor of 10^(1/3) apart in size and of 2 in knee:
    half a step in the logarithm. One fit has no more than 162 numbers to learn it from, and is some
    steps off in one of three where the field is as small as the noise; so the median of five.
    """
    chosen = [
        FIELD.tune(columns.T @ columns, columns.T @ residual)
        for columns, residual in (observed(size, knee, s) for s in range(5))
    ]
    assert abs(np.log(np.median([item.size for item in chosen]) / size)) < np.log(10) / 6
    assert abs(np.log2(np.median([item.knee for item in chosen]) / knee)) < 1 / 2
