"""How far the calibration's own views miss what the others say of them, over what sigma and noise
allow: the yardstick of a check.

Real corners are not Gaussian, and no model is perfect. So what a valid calibration leaves on views
that it has not seen is not taken from
the theory alone: each of its own views is checked against the fit of the others, by the very
    statistics that the pictures are checked by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.checking.equations import Equations
from calib.checking.known import Known
from calib.effects.effect import Effect

Array = NDArray[np.float64]

FEWEST = 4
"""Views of a calibration that can say how they spread."""
SURE = 3.0
"""Times what chance explains: from there on a change that all of a calibration's own views show is
one that it lacks.
"""
DEPENDENT = 1e-9
"""Of the largest eigenvalue: a direction of a change that moves less moves nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Dispersion:
    """Of a calibration; 1 everywhere is what theory has."""

    by_change: dict[str, float]
    """The variance along each change's directions, over what is predicted; not below 1."""
    freedom: dict[str, float]
    """How many squares that is estimated from; infinite where there are no views to ask."""
    lacking: dict[str, tuple[float, float]]
    """By how much each change would lower the calibration's own sum of squares, all views together,
    beyond chance, and of how much
    information: a calibration that lacks an effect shows it then and now, and has not changed.
    """
    logs: Array
    """(V,) logarithm of each view's squares over what is predicted."""

    @staticmethod
    def of(calibration: Calibration, known: Known, changes: tuple[Effect, ...]) -> Dispersion:
        if len(calibration.views) < FEWEST:
            return Dispersion(
                {c.name: 1.0 for c in changes},
                {c.name: np.inf for c in changes},
                {c.name: (0.0, 1.0) for c in changes},
                np.zeros(0),
            )
        equations = Equations.of(
            known, changes, calibration.observations, torch.from_numpy(calibration.poses)
        )
        apart = [equations.left_out(view) for view in range(len(calibration.views))]
        sizes, told, lacking = {}, {}, {}
        for change in changes:
            found = [explained(products, equations.columns(change.name)) for products, _ in apart]
            told[change.name] = float(sum(directions for _, directions in found)) or np.inf
            lacking[change.name] = _lacking(
                [products for products, _ in apart], equations.columns(change.name)
            )
            sizes[change.name] = max(1.0, sum(square for square, _ in found) / told[change.name])
        squares = np.array([products[0, 0] / max(1.0, freedom) for products, freedom in apart])
        return Dispersion(sizes, told, lacking, np.log(np.maximum(squares, 1e-12)))

    def scale(
        self, name: str, products: Array, columns: slice, directions: int, louder: float
    ) -> float:
        """The variance along a change's directions in other views, over what is predicted there.

        Args:
            products: of the other views, as `Equations.predicted`.
            louder: the variance of their noise over that of the calibration's.
        """
        excess, information = self.lacking[name]
        return (
            self.by_change[name] * louder
            + excess * float(np.trace(products[columns, columns])) / information / directions
        )

    @property
    def typical(self) -> float:
        """Of all directions together, not below 1."""
        return max(1.0, float(np.exp(self.logs.mean()))) if self.logs.size else 1.0


def _lacking(apart: list[Array], columns: slice) -> tuple[float, float]:
    together = np.sum(apart, axis=0)
    square, directions = explained(together, columns)
    by_chance = (
        max(
            1.0,
            sum(explained(products, columns)[0] for products in apart) / (len(apart) * directions),
        )
        if directions
        else 1.0
    )
    return max(0.0, square - SURE * directions * by_chance), max(
        float(np.trace(together[columns, columns])), 1e-300
    )


def explained(products: Array, columns: slice) -> tuple[float, int]:
    """By how much a change lowers the sum of squares, without a prior, and how many directions it
    has; from inner products with the residual first.
    """
    information, score = products[columns, columns], products[columns, 0]
    squared = information.diagonal()
    length = np.sqrt(np.where(squared > 0, squared, np.inf))  # what moves nothing explains nothing
    values, axes = np.linalg.eigh(information / np.outer(length, length))
    told = values > DEPENDENT * max(values.max(initial=0.0), 1e-300)
    along = axes.T[told] @ (score / length)
    return float((along**2 / values[told]).sum()), int(np.count_nonzero(told))
