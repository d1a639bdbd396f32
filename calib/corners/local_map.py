"""A local map from the board's plane to the picture: a polynomial of second or third order that is
fitted to the points around a place, nearer points with larger weights.

Lens and glass bend the picture of a board slowly. So the map needs no formula for them where enough
points are near.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REACH = 1.1  # units: standard deviation of the Gaussian weights
# The prior standard deviations of both orders, in parts of a unit's length in the picture:
SECOND_ORDER_PRIOR = 0.1  # how far a line bends over one unit
THIRD_ORDER_PRIOR = 0.02  # how much the bend changes from one unit to the next


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """The map's value and derivatives at N places of the board."""

    pixels: Floats
    """(N, 2) px"""
    steps: Floats
    """(N, 2 axes, 2) px per unit along the board's x and y: the first derivatives."""
    second_derivatives: Floats
    """(N, 2 axes, 2) px per squared unit along the board's x and y."""
    leverage: Floats
    """(N,) from 0 to 1: the weight that a point at this place has in the map's value there."""

    @staticmethod
    def fit(
        points: Floats, pixels: Floats, places: Floats, noise: float, *, cubic: bool = False
    ) -> "LocalMap":
        """Fit M points and evaluate the map at N places.

        Args:
            points: (M, 2) units of the board. A unit is about the distance of two points.
            pixels: (M, 2) px.
            places: (N, 2) units.
            noise: standard deviation of `pixels`, px.
            cubic: fit a third order, too. At a board's rim all points are on one side, so the
                second derivatives of a quadratic fit would belong to a place further inside.
        """
        offset = points - places[:, None]  # (N, M, 2)
        weight = np.exp(-(offset**2).sum(-1) / (2 * REACH**2))
        u, v = offset[..., 0], offset[..., 1]
        cubic_terms = [u**3 / 6, u * u * v / 2, u * v * v / 2, v**3 / 6] if cubic else []
        terms = np.stack(
            [np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, *cubic_terms], -1
        )  # (N, M, 6 or 10)
        weighted = terms * weight[..., None]
        normal = np.einsum("nmi,nmj->nij", weighted, terms)
        right_side = np.einsum("nmi,mc->nic", weighted, pixels - pixels.mean(0))
        unit_px = float(np.hypot(*np.ptp(pixels, axis=0)) / np.hypot(*np.ptp(points, axis=0)))  # px
        normal[:, [3, 4, 5], [3, 4, 5]] += (noise / (SECOND_ORDER_PRIOR * unit_px)) ** 2
        cubic_rows = range(6, terms.shape[-1])
        normal[:, cubic_rows, cubic_rows] += (noise / (THIRD_ORDER_PRIOR * unit_px)) ** 2
        normal[:, range(6), range(6)] += 1e-9
        fitted = np.linalg.solve(normal, right_side)
        leverage = np.linalg.inv(normal)[:, 0, 0]
        return LocalMap(fitted[:, 0] + pixels.mean(0), fitted[:, 1:3], fitted[:, [3, 5]], leverage)
