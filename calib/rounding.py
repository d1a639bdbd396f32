"""Text of a number for a person: a value with its standard deviation, both rounded to the second
digit of the latter, or a number of two digits.
"""

import math


def with_sigma(value: float, sigma: float) -> str:
    """Return text such as 1.0023 ± 0.0033; the value alone, with five digits, if there is no
    standard deviation.
    """
    if not (math.isfinite(value) and math.isfinite(sigma) and sigma > 0):
        return f"{value:.5g}"
    return f"{to_digit_of(value, sigma)} ± {to_digit_of(sigma, sigma)}"


def two_digits(value: float) -> str:
    """Return a number with two significant digits, such as 0.010 or 210, and no exponent."""
    return to_digit_of(value, abs(value)) if value else "0"


def to_digit_of(value: float, sigma: float) -> str:
    """Return the value to the second digit of a standard deviation, which is above 0."""
    exponent = int(f"{sigma:.1e}".partition("e")[2])  # of sigma as it is rounded: 0.0996 is 0.10
    places = 1 - exponent
    return f"{round(value, places) + 0.0:.{max(0, places)}f}"  # 0.0: no minus before a zero
