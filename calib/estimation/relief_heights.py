"""How uneven a fit says that the glass is."""

import numpy as np
from numpy.typing import NDArray

from calib.estimation.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path


def heights(path: Path, values: Values, observations: Observations) -> NDArray[np.float64]:
    """(M,) m, of the relief where corners' rays leave it, those aside that do not; empty without one."""
    outer = path.cover[-1:]
    if not outer or not path.relief:
        return np.zeros(0)
    values = observations.with_times(values)
    rays = path.trace(observations.pixels, values)
    chart = outer[0].surface.chart(outer[0].frame.enter(rays.origin, values))
    return np.asarray(path.relief.height(chart, values)[0].numpy()[rays.failure.numpy() == 0])


def unevenness(path: Path, values: Values, observations: Observations) -> float:
    """m, standard deviation of these heights: an even layer is thickness; 0 without a relief."""
    found = heights(path, values, observations)
    return float(found.std()) if found.size else 0.0
