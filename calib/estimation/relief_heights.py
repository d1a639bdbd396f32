"""The unevenness of the glass according to a fit."""

import numpy as np

from calib.estimation.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.tolerances import GLASS_FIGURE

MAX_UNEVENNESS = 3 * GLASS_FIGURE.sigma
"""m, root mean square: three standard deviations of cheap glass. `fixtures/bumps`, made to be bad,
has a third of it.
"""


def height_spread(path: Path, values: Values, observations: Observations) -> float:
    """Return the standard deviation, m, of the relief's height at the points where corners' rays
    leave it (the mean is thickness); 0 without a relief.
    """
    outer = path.cover[-1:]
    if not outer or not path.relief:
        return 0.0
    rays = path.trace(observations.pixels, values, observations.exposure)
    _, values = path.adjust_pixels(observations.pixels, values, observations.exposure)
    heights = outer[0].relief_height(outer[0].frame.at(values).enter(rays.origin), values)
    return float(np.std(heights.numpy()[rays.failure.numpy() == 0]))
