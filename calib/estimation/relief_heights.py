"""The unevenness of the glass according to a fit."""

import numpy as np

from calib.estimation.corner_cells import spread_part
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
    leave it (the mean is thickness), of a part of very many corners; 0 without a relief.
    """
    outer = path.cover[-1:]
    if not outer or not path.relief:
        return 0.0
    heights = []
    for batch in spread_part(observations).batches():
        rays = path.trace(batch.pixels, values, batch.exposure)
        _, adjusted = path.adjust_pixels(batch.pixels, values, batch.exposure)
        points = outer[0].frame.at(adjusted).enter(rays.origin)
        heights.append(outer[0].relief_height(points, adjusted).numpy()[rays.failure.numpy() == 0])
    return float(np.std(np.concatenate(heights)))
