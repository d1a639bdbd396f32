"""A value and its standard deviation as people write them: both to the second digit of the standard
deviation.
"""

import math


def with_sigma(value: float, sigma: float) -> str:
    """1.0023 ± 0.0033; by itself, with five digits, where there is no standard deviation to go
    by.
    """
    if not (math.isfinite(value) and math.isfinite(sigma) and sigma > 0):
        return f"{value:.5g}"
    return f"{to_digit_of(value, sigma)} ± {to_digit_of(sigma, sigma)}"


def to_digit_of(value: float, sigma: float) -> str:
    """The value to the second digit of a standard deviation above 0."""
    exponent = int(f"{sigma:.1e}".partition("e")[2])  # of sigma as it is rounded: 0.0996 is 0.10
    places = 1 - exponent
    return f"{round(value, places) + 0.0:.{max(0, places)}f}"  # 0.0: no minus before a zero
