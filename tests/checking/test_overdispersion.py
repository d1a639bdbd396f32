"""The squares that a change explains, from inner products that rounding has spoilt."""

import numpy as np
import pytest

from calib.checking.overdispersion import explained_squares


def test_a_number_that_moves_nothing_explains_nothing() -> None:
    """Corners without noise leave it a rounding error as its information, beside products with
    others that are larger.
    """
    information = np.array([[4.0, 0.0, 1e-9], [0.0, 1.0, 0.0], [1e-9, 0.0, -1e-12]])
    products = np.zeros((4, 4))
    products[1:, 1:] = information
    products[0, 1:] = products[1:, 0] = [2.0, 3.0, 1e-9]
    square, directions = explained_squares(products, slice(1, 4))
    assert square == pytest.approx(1.0 + 9.0)
    assert directions == 2
