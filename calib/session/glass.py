"""What is known of a cover's unevenness beforehand: the figure of its outer surface, as a fleet of
such covers has it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.session.schema import Section

Array = NDArray[np.float64]

MOST_DEGREE = 10
"""Of the figure: what is finer is texture."""
MICRO = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Glass:
    """A figure, the sum of products of Legendre polynomials over a patch of the cover's chart: its
    coefficients are normal, and correlated with each other and with the numbers of camera and
    cover, beside which they do much the same.
    """

    low: tuple[float, float]
    """Chart coordinates of the patch's first corner, and `high` of its last, as calib.optics.relief
    has them.
    """
    high: tuple[float, float]
    degree: int
    """The highest of both directions together; with it N coefficients, in the order of `degrees`.
    """
    mean: Array
    """(N,) m"""
    covariance: Array
    """(N, N) m^2"""
    numbers: tuple[str, ...]
    """K names of numbers, and the (N, K) covariance `beside` of the coefficients with them, in m
    times SI units or px.
    """
    beside: Array

    @property
    def degrees(self) -> tuple[tuple[int, int], ...]:
        return degrees(self.degree)


def degrees(highest: int) -> tuple[tuple[int, int], ...]:
    """Of the polynomials along the first and along the second chart coordinate."""
    return tuple((i, k) for i in range(highest + 1) for k in range(highest + 1 - i))


def glass_to_yaml(glass: Glass) -> dict[str, object]:
    """The mapping that `read_glass` reads as this glass."""
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
            name: [float(value) for value in glass.beside[:, i] * MICRO]
            for i, name in enumerate(glass.numbers)
        },
    }


def read_glass(section: Section) -> Glass:
    """Whether its covariance can be one is checked where the numbers' own is known too."""
    section.only(("low", "high", "degree", "mean_um", "covariance_um2", "covariance_um"))
    degree = section.whole("degree", 0, MOST_DEGREE)
    count = len(degrees(degree))
    low, high = (_row(section, key, section.get(key, "two numbers"), 2) for key in ("low", "high"))
    if not (low < high).all():
        raise section.wrong("high", section.values["high"], "two numbers, each above that of low")
    mean = _row(section, "mean_um", section.get("mean_um", f"{count} numbers"), count) / MICRO
    expected = f"{count} rows, of one number, of two and so on"
    written = section.get("covariance_um2", expected)
    if not isinstance(written, list) or len(written) != count:
        raise section.wrong("covariance_um2", written, expected)
    covariance = np.zeros((count, count))
    for i, row in enumerate(written):
        covariance[i, : i + 1] = covariance[: i + 1, i] = (
            _row(section, f"covariance_um2[{i}]", row, i + 1) / MICRO**2
        )
    rows = section.section("covariance_um", "{cover.thickness: [...]}").values
    beside = np.zeros((count, len(rows)))
    for i, (name, column) in enumerate(rows.items()):
        beside[:, i] = _row(section, f"covariance_um.{name}", column, count) / MICRO
    return Glass(
        (float(low[0]), float(low[1])),
        (float(high[0]), float(high[1])),
        degree,
        mean,
        covariance,
        tuple(rows),
        beside,
    )


def _row(section: Section, key: str, written: object, count: int) -> Array:
    if isinstance(written, list) and len(written) == count:
        numbers = [
            value
            for value in written
            if isinstance(value, int | float) and not isinstance(value, bool)
        ]
        if len(numbers) == count and np.isfinite(numbers).all():
            return np.array(numbers, np.float64)
    raise section.wrong(key, written, f"{count} numbers")
