"""Overdispersion of a calibration: the errors of its own views, each predicted from the others,
over the errors that sigma and noise predict.

Real corners are not Gaussian, and no model is perfect. So the error of a valid calibration on new
views is not taken from theory alone: each of its own views is tested against the fit of the other
views, by the same statistics as the pictures of a check.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.checking.posterior_predictive import PosteriorPredictive
from calib.checking.prior import CalibrationPrior
from calib.effects.effect import Effect

Array = NDArray[np.float64]

MIN_VIEWS = 4
"""The fewest views from which an overdispersion is estimated."""
SIGNIFICANT = 3.0
"""Times the explanation by chance: a change that lowers the squares of a calibration's own views by
more is an effect that its model lacks.
"""
RANK_TOLERANCE = 1e-9
"""Relative to the largest eigenvalue: directions of a change below it move no corner."""
NO_INFORMATION = 1e-200
"""The largest information on a number that moves no corner except by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Overdispersion:
    """The overdispersion of a calibration; theory predicts 1 everywhere."""

    by_change: dict[str, float]
    """The variance along the directions of each change over the predicted one, at least 1."""
    freedom: dict[str, float]
    """The number of squares behind each estimate; infinite without views."""
    lacking: dict[str, tuple[float, float]]
    """For each change, the amount beyond chance by which it lowers the sum of squares of the
    calibration's own views, and its information there. A model that lacks an effect shows it
    before and after: then nothing has changed.
    """
    logs: Array
    """(V,) logarithm of each view's squares over the prediction."""

    @staticmethod
    def of(
        calibration: Calibration, prior: CalibrationPrior, changes: tuple[Effect, ...]
    ) -> Overdispersion:
        """Estimate the overdispersion from the calibration's views, each left out in turn."""
        if len(calibration.views) < MIN_VIEWS:
            return Overdispersion.of_left_out((), {change.name: slice(0) for change in changes})
        poses = torch.from_numpy(calibration.poses)
        predictive = PosteriorPredictive.of(prior, changes, calibration.observations, poses)
        left_out = [predictive.leave_one_out(view) for view in range(len(calibration.views))]
        columns = {change.name: predictive.columns(change.name) for change in changes}
        return Overdispersion.of_left_out(left_out, columns)

    @staticmethod
    def of_left_out(
        left_out: Sequence[tuple[Array, float]], columns: Mapping[str, slice]
    ) -> Overdispersion:
        """Estimate the overdispersion from views that were each left out in turn.

        Args:
            left_out: the results of `PosteriorPredictive.leave_one_out`; fewer than MIN_VIEWS count
                as none.
            columns: those of each change there.
        """
        if len(left_out) < MIN_VIEWS:
            return Overdispersion(
                by_change=dict.fromkeys(columns, 1.0),
                freedom=dict.fromkeys(columns, np.inf),
                lacking=dict.fromkeys(columns, (0.0, 1.0)),
                logs=np.zeros(0),
            )
        products = [view_products for view_products, _ in left_out]
        by_change = {}
        freedom = {}
        lacking = {}
        for name, place in columns.items():
            explanations = [explained_squares(view_products, place) for view_products in products]
            directions = float(sum(count for _, count in explanations)) or np.inf
            squares = sum(square for square, _ in explanations)
            by_change[name] = max(1.0, squares / directions)
            freedom[name] = directions
            lacking[name] = _lacking(products, place)
        ratios = [view_products[0, 0] / max(1.0, count) for view_products, count in left_out]
        return Overdispersion(by_change, freedom, lacking, np.log(np.maximum(ratios, 1e-12)))

    def scale(
        self, name: str, products: Array, columns: slice, directions: int, noise_ratio: float
    ) -> float:
        """Return the variance along a change's directions in other views over the predicted one.

        Args:
            products: `PosteriorPredictive.normalised_products` of the other views.
            noise_ratio: the noise variance of these views over that of the calibration's.
        """
        excess, information = self.lacking[name]
        trace = float(np.trace(products[columns, columns]))
        return self.by_change[name] * noise_ratio + excess * trace / information / directions

    @property
    def typical(self) -> float:
        """The overdispersion of all directions together, at least 1."""
        return max(1.0, float(np.exp(self.logs.mean()))) if self.logs.size else 1.0


def _lacking(products: list[Array], columns: slice) -> tuple[float, float]:
    total = np.sum(products, axis=0)
    square, directions = explained_squares(total, columns)
    by_chance = 1.0
    if directions:
        squares = sum(explained_squares(view_products, columns)[0] for view_products in products)
        by_chance = max(1.0, squares / (len(products) * directions))
    excess = max(0.0, square - SIGNIFICANT * directions * by_chance)
    return excess, max(float(np.trace(total[columns, columns])), 1e-300)


def explained_squares(products: Array, columns: slice) -> tuple[float, int]:
    """Return the amount by which a change lowers the sum of squares, without a prior, and the
    number of its directions, from inner products with the residual first.
    """
    information = products[columns, columns]
    score = products[columns, 0]
    squares = information.diagonal()
    length = np.sqrt(np.where(squares > NO_INFORMATION, squares, np.inf))
    correlation = (information / np.outer(length, length)).clip(-1.0, 1.0)  # rounding exceeds 1
    values, axes = np.linalg.eigh(correlation)
    resolved = values > RANK_TOLERANCE * max(values.max(initial=0.0), 1e-300)
    projections = axes.T[resolved] @ (score / length)
    return float((projections**2 / values[resolved]).sum()), int(np.count_nonzero(resolved))
