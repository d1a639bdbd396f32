"""The residuals of views that a calibration predicts, with its own uncertainty integrated out, as
inner products.

Let z be the residual of a view after the elimination of the view's own parameters, B its Jacobian
by the calibrated parameters times the root of their covariance, and N its Jacobian by the
parameters of a change. Under a valid calibration z is normal with covariance V = 1 + B B^T; the
columns N are compared with it in the metric V^-1.

The calibrated parameters are not eliminated, as a fit eliminates the views' own ones: they keep
their prior, and the views do not change them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.checking.prior import CalibrationPrior
from calib.effects.effect import Effect
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.view_equations import view_equations
from calib.optics.params import Values

Array = NDArray[np.float64]

MIN_REMAINING_VARIANCE = 0.1
"""The smallest fraction of a residual's variance that a fit may leave in a direction. Below it, one
view alone determines the direction, and the other views do not predict it.
"""


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorPredictive:
    """The distribution of the residuals of V views under a calibration."""

    products: Array
    """(V, n, n) inner products of a view's columns: the residual, the S calibrated parameters, then
    the parameters of all changes; px over sigma.
    """
    freedom: Array
    """(V,) degrees of freedom: residuals minus the view's own parameters."""
    calibrated: int
    """S, the number of calibrated parameters."""
    places: dict[str, slice]
    """The columns of each change, by its name."""
    sigma: float
    """The noise of a corner, px per axis."""

    @staticmethod
    def of(
        prior: CalibrationPrior,
        changes: Sequence[Effect],
        observations: Observations,
        poses: Tensor,
        at: Values | None = None,
    ) -> PosteriorPredictive:
        """Linearise at (V, B) view parameters and the calibration's values, replaced by those of
        `at`.

        A change that the calibration has as an effect is a change of that effect.
        """
        parameters, new = parameters_with_changes(prior, changes)
        parameters = replace(parameters, origin={**parameters.origin, **(at or {})})
        path = prior.model.with_effects(new).path
        entries = {
            change.name: parameters.entries(u.param.name for u in change.effect_parameters)
            for change in changes
        }
        columns = np.concatenate([np.zeros(0, np.int64), *entries.values()])
        products, freedom = [], []
        for view in view_equations(path, parameters, observations, poses, prior.sigma):
            reduced = view.reduce()
            rows = np.column_stack(
                [
                    reduced.residual,
                    reduced.jacobian[:, : len(prior.root)] @ prior.root,
                    reduced.jacobian[:, columns],
                ]
            )
            products.append(rows.T @ rows)
            freedom.append(reduced.freedom)
        ends = (
            1
            + len(prior.root)
            + np.cumsum([0, *(len(columns_of_change) for columns_of_change in entries.values())])
        )
        places = {
            name: slice(int(first), int(last))
            for name, first, last in zip(entries, ends, ends[1:], strict=False)
        }
        size = 1 + len(prior.root) + len(columns)
        return PosteriorPredictive(
            products=np.array(products).reshape(-1, size, size),
            freedom=np.array(freedom, dtype=np.float64),
            calibrated=len(prior.root),
            places=places,
            sigma=prior.sigma,
        )

    def normalised_products(self, views: slice | NDArray[np.int64] = slice(None)) -> Array:
        """Return the (n, n) inner products of these views in the metric V^-1: the residual first,
        then the changes.
        """
        products, inner = self.products[views].sum(0), slice(1, 1 + self.calibrated)
        kept_columns = self._other_columns(products)
        cross = products[kept_columns, inner]
        spread = np.eye(self.calibrated) + products[inner, inner]
        return np.asarray(
            products[np.ix_(kept_columns, kept_columns)] - cross @ np.linalg.solve(spread, cross.T)
        )

    def log_determinant(self, views: NDArray[np.int64]) -> float:
        """Return the logarithm of the determinant of V of these views."""
        inner = slice(1, 1 + self.calibrated)
        return float(
            np.linalg.slogdet(np.eye(self.calibrated) + self.products[views].sum(0)[inner, inner])[
                1
            ]
        )

    def leave_one_out(self, view: int) -> tuple[Array, float]:
        """Return the inner products of a fitted view against the prediction of the other views, and
        its degrees of freedom.

        The fit to this view is undone to first order: its residual in the fit is V^-1 times its
        residual in a fit without the view, with V from the covariance of the latter.
        """
        products, inner = self.products[view], slice(1, 1 + self.calibrated)
        values, axes = np.linalg.eigh(np.eye(self.calibrated) - products[inner, inner])
        predictable = values > MIN_REMAINING_VARIANCE
        kept_columns = self._other_columns(products)
        result = products[np.ix_(kept_columns, kept_columns)].copy()
        cross = products[kept_columns, inner]
        result[1:, 1:] -= cross[1:] @ cross[1:].T
        result[0, 0] += float(((cross[0] @ axes[:, predictable]) ** 2 / values[predictable]).sum())
        return result, float(self.freedom[view] - np.count_nonzero(~predictable))

    def _other_columns(self, products: Array) -> NDArray[np.int64]:
        """Return the columns of the residual and of the changes."""
        return np.array([0, *range(1 + self.calibrated, len(products))])

    def columns(self, name: str) -> slice:
        """Return the columns of a change in `normalised_products` and `leave_one_out`."""
        place = self.places[name]
        return slice(place.start - self.calibrated, place.stop - self.calibrated)

    @property
    def calibration_variance(self) -> Array:
        """(V,) the part of each view's expected sum of squares that is due to the uncertainty of
        the calibration.
        """
        inner = slice(1, 1 + self.calibrated)
        return np.asarray(np.trace(self.products[:, inner, inner], axis1=1, axis2=2))


def parameters_with_changes(
    prior: CalibrationPrior, changes: Sequence[Effect]
) -> tuple[Parameters, list[Effect]]:
    """Return the calibrated parameters followed by those of changes at their neutral values, and
    the changes that are not effects of the calibration.
    """
    names = {effect.name for effect in prior.model.effects}
    new = [change for change in changes if change.name not in names]
    wider = prior.model.with_effects(new)
    neutral = {
        name: value for effect in new for name, value in prior.model.neutral_values(effect).items()
    }
    calibrated = prior.parameters
    added = [u.param for effect in new for u in effect.effect_parameters]
    free = tuple(dict.fromkeys([*calibrated.free, *added]))  # two changes may share a parameter
    return Parameters({**calibrated.origin, **neutral}, calibrated.relief, free, wider.priors), new


def prior_spread(change: Effect) -> Array:
    """Return the (k,) prior standard deviations of a change's parameters, over their scales."""
    spreads = (
        np.broadcast_to(np.asarray(u.sigma, np.float64) / u.param.scale, u.param.shape).ravel()
        for u in change.effect_parameters
    )
    return np.concatenate([np.zeros(0), *spreads])
