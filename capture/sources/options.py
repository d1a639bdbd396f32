"""Options of a source: numbers and sizes."""

import re

from calib.session.schema import Quantity, Section

EXPOSURE_US = Quantity("exposure_us", low=1, high=1e7)
GAIN = Quantity("gain", low=0, high=1e5)
PATIENCE_S = Quantity("patience_s", low=1, high=3600, default=10.0)
"""The time in s that a connected camera may send nothing before the source gives up; the person is
told after one second.
"""


COLOUR = "colour"
"""The switch for pictures in colour. Calibrations need grey values alone, which are exact."""
AUTO = "auto"
"""The switch for exposure, gain and white balance that follow the light, as a stream wants them;
those that an option states are still fixed, and so is the focus.
"""


def read_number(options: Section, quantity: Quantity) -> float | None:
    """Return the option's value; None where it is not given and has no default."""
    if quantity.key not in options.values and quantity.default is None:
        return None
    return options.read(quantity)[quantity.names[0]].value


def read_size(options: Section) -> tuple[int, int] | None:
    """Return width and height, px, of `size=1640x1232`; None where it is not given."""
    if "size" not in options.values:
        return None
    expected = "width and height in px, such as 1640x1232"
    match = re.fullmatch(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})", options.text("size", expected))
    if not match:
        raise options.error("size", options.values["size"], expected)
    return int(match[1]), int(match[2])


def read_switch(options: Section, key: str) -> bool:
    """Return True for `key=yes`; False for `key=no`, and where it is not given."""
    return key in options.values and options.choice(key, ("yes", "no"), "yes or no") == "yes"
