"""The choice of views that are dropped for their error."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calib.estimation.robust import outlier_mask

ALIKE = np.array([0.09, 0.10, 0.11, 0.10, 0.12, 0.08, 0.10])  # median 0.1, median deviation 0.01


def test_a_view_that_does_not_belong_is_the_only_outlier() -> None:
    for place in range(8):
        errors = np.insert(ALIKE, place, 3.0)
        assert np.flatnonzero(outlier_mask(errors)).tolist() == [place]


def test_no_outlier_is_found_among_alike_views() -> None:
    assert not outlier_mask(ALIKE).any()
    assert not outlier_mask(np.full(5, 0.1)).any()
    assert not outlier_mask(np.zeros(5)).any(), "exact data"


@pytest.mark.parametrize(("error", "out"), [(0.399, False), (0.401, True)])
def test_views_that_agree_allow_four_times_their_median(error: float, out: bool) -> None:
    """Eight robust standard deviations would be 0.22 here."""
    assert outlier_mask(np.append(ALIKE, error)).tolist() == [False] * 7 + [out]


@pytest.mark.parametrize(("error", "out"), [(6.8, False), (7.1, True)])
def test_views_that_scatter_allow_eight_standard_deviations(error: float, out: bool) -> None:
    """The median is 1 and the median deviation 0.5: 1 + 8 * 1.4826 * 0.5 = 6.93, where four times
    the median would be 4.
    """
    assert outlier_mask(np.array([0.4, 0.5, 0.5, 1.0, 1.0, 1.5, 1.5, 1.6, error])).tolist() == [
        False
    ] * 8 + [out]


def test_bad_views_are_found_as_long_as_most_are_good() -> None:
    errors = np.concatenate([ALIKE, [2.0, 3.0, 4.0, 50.0, 6.0]])
    assert outlier_mask(errors).tolist() == [False] * 7 + [True] * 5


@pytest.mark.parametrize("invalid_value", [np.nan, np.inf])
def test_an_error_that_is_not_finite_is_an_outlier_and_hides_no_other(invalid_value: float) -> None:
    """Not even where most views have no error: the others are judged by themselves."""
    errors = np.concatenate([[invalid_value] * 9, ALIKE, [3.0]])
    assert outlier_mask(errors).tolist() == [True] * 9 + [False] * 7 + [True]
    assert outlier_mask(np.full(4, invalid_value)).all()


positive = arrays(
    np.float64,
    st.integers(1, 30),
    elements=st.one_of(st.floats(1e-3, 1e3), st.just(np.nan), st.just(np.inf)),
)


@given(positive, st.floats(-6, 6))
def test_the_outliers_are_the_largest_errors_in_any_unit(errors: np.ndarray, power: float) -> None:
    """The larger half is the most that can go, and whatever is smaller than an error that stays,
    stays.
    """
    out = outlier_mask(errors)
    finite = np.isfinite(errors)
    assert out[~finite].all()
    assert out[finite].sum() * 2 <= finite.sum()
    if finite.any():
        assert errors[finite & ~out].max() < errors[finite & out].min(initial=np.inf)
    assert np.array_equal(outlier_mask(errors * 2.0 ** int(power)), out)
    assert np.array_equal(outlier_mask(errors[::-1]), out[::-1])
