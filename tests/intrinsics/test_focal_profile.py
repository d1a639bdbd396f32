"""The profile of an error over the focal length, on errors that are known in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from calib.intrinsics.focal_profile import LEVEL, MAX_RATIO, profile_focal_length

FREEDOM = 500


@dataclass(frozen=True)
class Left:
    """The result of a fit."""

    rms: float


def over(deviations: Callable[[float], float]) -> Callable[[float], Left]:
    """A fit at so many times the focal length, which the views say is so many standard deviations
    off.
    """
    return lambda times: Left(0.1 * (1 + deviations(times) ** 2 / FREEDOM) ** 0.5)


@pytest.mark.parametrize("sigma", [0.001, 0.02])
@pytest.mark.parametrize("expected", [0.3, 1.0, 1e-9])
def test_a_parabola_gives_its_own_sigma(sigma: float, expected: float) -> None:
    """Whatever the linearised sigma says: what is far from it is bracketed by doubling."""
    interval, best = profile_focal_length(
        Left(0.1), over(lambda times: np.log(times) / sigma), FREEDOM, expected * sigma
    )
    assert interval.closed
    assert interval.sigma == pytest.approx(
        sigma, rel=0.04
    )  # of log f: three sigma of 2 % are 6.2 %
    assert best.rms == 0.1


def test_a_side_that_never_rises_is_open() -> None:
    """Boards that do not tilt: any longer focal length will do."""
    interval, _ = profile_focal_length(
        Left(0.1), over(lambda times: 1.0 if times > 1 else np.log(times) / 0.01), FREEDOM, 0.01
    )
    assert interval.high == np.inf
    assert interval.low == pytest.approx(1 - LEVEL * 0.01, abs=0.001)
    assert not interval.closed


def test_the_longer_side_counts() -> None:
    interval, _ = profile_focal_length(
        Left(0.1), over(lambda times: np.log(times) / (0.05 if times > 1 else 0.01)), FREEDOM, 0.01
    )
    assert interval.sigma == pytest.approx((np.exp(LEVEL * 0.05) - 1) / LEVEL, rel=1e-3)


def test_a_better_minimum_is_found() -> None:
    """At twice the focal length, beyond a ridge that is no higher than two standard deviations."""
    _, best = profile_focal_length(
        Left(0.1),
        lambda times: Left(0.09 if times > 1.5 else 0.1 * (1 + 4 / FREEDOM) ** 0.5),
        FREEDOM,
        0.02,
    )
    assert best.rms == 0.09


def test_the_profile_is_closed_if_no_other_focal_length_fits() -> None:
    interval, _ = profile_focal_length(Left(0.1), lambda _: Left(np.inf), FREEDOM, 0.01)
    assert interval.closed
    assert 1 / MAX_RATIO < interval.low < 1 < interval.high < MAX_RATIO
