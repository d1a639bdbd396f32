"""The simplex search against scipy's."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize, rosen

from calib.estimation.simplex_search import simplex_search


def valley(place: NDArray[np.float64]) -> float:
    return float(rosen(np.append(place, 1.0)))


@pytest.mark.parametrize(
    ("start", "low", "high"),
    [
        ([-1.2, 1.0], [-2.0, -2.0], [2.0, 2.0]),
        ([0.0, 0.5, 1.9], [-2.0, -2.0, 0.5], [0.8, 2.0, 2.0]),
        ([0.7, -0.3], [0.7, -2.0], [0.7, 2.0]),
        ([3.0], [1.0], [9.0]),
    ],
    ids=["free", "at limits", "one coordinate fixed", "one coordinate"],
)
def test_it_ends_where_scipy_does(start: list[float], low: list[float], high: list[float]) -> None:
    reference = minimize(
        valley,
        np.array(start),
        method="Nelder-Mead",
        bounds=list(zip(low, high, strict=True)),
        options={"xatol": 0.01, "fatol": 0.01},
    )
    result = simplex_search(valley, np.array(start), np.array(low), np.array(high), 0.01)
    np.testing.assert_allclose(result, reference.x, atol=1e-9)
