"""The prior of a cover's unevenness: the figure of its outer surface, estimated from a fleet of
such covers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.session.schema import Section

Array = NDArray[np.float64]

MAX_DEGREE = 10
"""The highest degree of a figure: finer relief is texture."""
MICRO = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Glass:
    """The prior of a figure: a sum of products of Legendre polynomials over a patch of the cover's
    chart.

    Its coefficients are normally distributed. They are correlated with each other and with the
    numbers of camera and cover, which have similar effects on the picture.
    """

    low: tuple[float, float]
    """The chart coordinates of the patch's first corner, as in calib.optics.relief; `high` is its
    last corner.
    """
    high: tuple[float, float]
    degree: int
    """The highest total degree in both directions. It gives N coefficients, in the order of
    `polynomial_degrees`.
    """
    mean: Array
    """(N,) m"""
    covariance: Array
    """(N, N) m^2"""
    numbers: tuple[str, ...]
    """The K names of numbers of camera and cover."""
    cross_covariance: Array
    """(N, K) covariance of the coefficients with these numbers, in m times SI units or px."""


def polynomial_degrees(highest: int) -> tuple[tuple[int, int], ...]:
    """Return the degrees of the polynomials along the first and the second chart coordinate."""
    return tuple((i, k) for i in range(highest + 1) for k in range(highest + 1 - i))


def glass_to_yaml(glass: Glass) -> dict[str, object]:
    """Return the mapping that `read_glass` reads as this glass."""
    lower = [
        [float(value) for value in row[: i + 1] * MICRO**2]
        for i, row in enumerate(glass.covariance)
    ]
    return {
        "low": list(glass.low),
        "high": list(glass.high),
        "degree": glass.degree,
        "mean_um": [float(value) for value in glass.mean * MICRO],
        "covariance_um2": lower,
        "covariance_um": {
            name: [float(value) for value in glass.cross_covariance[:, i] * MICRO]
            for i, name in enumerate(glass.numbers)
        },
    }


def read_glass(section: Section) -> Glass:
    """Read the prior. Whether its covariance is possible is checked once that of the numbers is
    known (`check_correlations`).
    """
    section.allow_only(("low", "high", "degree", "mean_um", "covariance_um2", "covariance_um"))
    degree = section.integer("degree", 0, MAX_DEGREE)
    count = len(polynomial_degrees(degree))
    low = _row(section, "low", section.get("low", "two numbers"), 2)
    high = _row(section, "high", section.get("high", "two numbers"), 2)
    if not (low < high).all():
        raise section.error("high", section.values["high"], "two numbers, each above that of low")
    mean = _row(section, "mean_um", section.get("mean_um", f"{count} numbers"), count) / MICRO
    expected = f"{count} rows, of one number, of two and so on"
    matrix = section.get("covariance_um2", expected)
    if not isinstance(matrix, list) or len(matrix) != count:
        raise section.error("covariance_um2", matrix, expected)
    covariance = np.zeros((count, count))
    for i, row in enumerate(matrix):
        covariance[i, : i + 1] = covariance[: i + 1, i] = (
            _row(section, f"covariance_um2[{i}]", row, i + 1) / MICRO**2
        )
    rows = section.section("covariance_um", "{cover.thickness: [...]}").values
    cross_covariance = np.zeros((count, len(rows)))
    for i, (name, column) in enumerate(rows.items()):
        cross_covariance[:, i] = _row(section, f"covariance_um.{name}", column, count) / MICRO
    return Glass(
        low=(float(low[0]), float(low[1])),
        high=(float(high[0]), float(high[1])),
        degree=degree,
        mean=mean,
        covariance=covariance,
        numbers=tuple(rows),
        cross_covariance=cross_covariance,
    )


def _row(section: Section, key: str, written: object, count: int) -> Array:
    """Return `count` finite numbers, or raise InputError."""
    if isinstance(written, list) and len(written) == count:
        numbers = [
            value
            for value in written
            if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        if len(numbers) == count and np.isfinite(numbers).all():
            return np.array(numbers, np.float64)
    raise section.error(key, written, f"{count} numbers")
