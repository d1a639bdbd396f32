"""The simplex method of J. A. Nelder and R. Mead (1965), as scipy.optimize has it. The import of
scipy.optimize takes 0.08 s of CPU, which every fit would pay for this search.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIRST_STEP = 0.05
"""The sides of the first simplex, relative to the start's coordinates."""
STEP_FROM_ZERO = 2.5e-4
"""The side along a coordinate that starts at zero."""
MAX_STEPS = 200
"""The largest number of steps for each coordinate."""


def simplex_search(
    cost: Callable[[Array], float], start: Array, low: Array, high: Array, tolerance: float
) -> Array:
    """Return (n,) a place between limits where the cost has a minimum.

    Args:
        cost: the function.
        start: (n,) where the search starts: between the limits.
        low: (n,) the lower limits.
        high: (n,) the upper limits.
        tolerance: the search ends when all corners of the simplex are closer to the best one than
            this, in every coordinate and in the cost.
    """
    steps = np.where(start == 0, STEP_FROM_ZERO, FIRST_STEP * start)
    places = np.vstack([start, start + np.diag(steps)])
    places = np.where(places > high, 2 * high - places, places).clip(low, high)
    costs = np.array([cost(place) for place in places])
    for _ in range(MAX_STEPS * len(start)):
        order = costs.argsort()
        places, costs = places[order], costs[order]
        if max(np.abs(places - places[0]).max(), costs[-1] - costs[0]) <= tolerance:
            break
        middle, worst = places[:-1].mean(0), places[-1]
        place = (2 * middle - worst).clip(low, high)
        reached = cost(place)
        if reached < costs[0]:
            farther = (3 * middle - 2 * worst).clip(low, high)
            farther_cost = cost(farther)
            if farther_cost < reached:
                place, reached = farther, farther_cost
        elif reached >= costs[-2]:
            limit = min(reached, costs[-1])
            if reached < costs[-1]:
                place = (1.5 * middle - 0.5 * worst).clip(low, high)
            else:
                place = (0.5 * middle + 0.5 * worst).clip(low, high)
            reached = cost(place)
            if reached > limit:
                places[1:] = (places[0] + 0.5 * (places[1:] - places[0])).clip(low, high)
                costs[1:] = [cost(place) for place in places[1:]]
                continue
        places[-1], costs[-1] = place, reached
    return np.asarray(places[costs.argmin()])
