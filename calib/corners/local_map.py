"""A board's plane -> the picture, near each of some places: a fit of second or third order to the
points around it, the nearer the heavier.

Lens and glass bend the picture of a board, slowly: no formula of theirs is needed where enough
points are near.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REACH = 1.1  # units: standard deviation of the weights
STIFF = 0.1  # of a unit's length in the picture: how far a line bends over one
STEADY = 0.02  # the same: how much that changes from one unit to the next


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """At N places of the board."""

    pixels: Floats
    """(N, 2) px"""
    steps: Floats
    """(N, 2 axes, 2) px for each unit along the board's x and y."""
    bends: Floats
    """(N, 2 axes, 2) px for each squared unit."""
    leverage: Floats
    """(N,) by how much a point at such a place draws the map there to itself, 0 to 1."""

    @staticmethod
    def of(
        points: Floats, pixels: Floats, at: Floats, noise: float, *, changing: bool = False
    ) -> "LocalMap":
        """Fit M points, at N places.

        Args:
            points: (M, 2) units of the board, of about the distance of two points.
            pixels: (M, 2) px, each by some `noise` off.
            at: (N, 2) units.
            changing: whether bends may change, by a third order: at a board's rim, where all other
                points are on one side, they are else those of the points there.
        """
        apart = points - at[:, None]  # (N, M, 2)
        weight = np.exp(-(apart**2).sum(-1) / (2 * REACH**2))
        u, v = apart[..., 0], apart[..., 1]
        third = [u**3 / 6, u * u * v / 2, u * v * v / 2, v**3 / 6] if changing else []
        terms = np.stack(
            [np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2, *third], -1
        )  # (N, M, 6 or 10)
        weighted = terms * weight[..., None]
        normal = np.einsum("nmi,nmj->nij", weighted, terms)
        right = np.einsum("nmi,mc->nic", weighted, pixels - pixels.mean(0))
        unit = float(np.hypot(*np.ptp(pixels, axis=0)) / np.hypot(*np.ptp(points, axis=0)))  # px
        normal[:, [3, 4, 5], [3, 4, 5]] += (noise / (STIFF * unit)) ** 2
        cubic = range(6, terms.shape[-1])
        normal[:, cubic, cubic] += (noise / (STEADY * unit)) ** 2
        normal[:, range(6), range(6)] += 1e-9
        fitted = np.linalg.solve(normal, right)
        leverage = np.linalg.inv(normal)[:, 0, 0]
        return LocalMap(fitted[:, 0] + pixels.mean(0), fitted[:, 1:3], fitted[:, [3, 5]], leverage)
