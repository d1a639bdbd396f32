"""The linearised equations of views, each view's own parameters eliminated, as inner products: all
that the test needs of them.

With z a view's residual, B its Jacobian by the known parameters times the root of their covariance,
and N that by a change, the residual of a valid calibration is normal with covariance V = 1 + B B^T;
the changes' columns N are compared with it in that metric (V^-1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.checking.known import Known
from calib.effects.effect import Effect
from calib.estimation.elimination import orthonormal_basis, view_equations
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.optics.params import Values

Array = NDArray[np.float64]

LEAST_LEFT = 0.1
"""Of a variance, after a fit: what is less is held by one view alone, so that the others say
nothing of it.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Of V views."""

    products: Array
    """(V, n, n) inner products of a view's columns: its residual, then the S known ones, then those
    of all changes; px over sigma.
    """
    freedom: Array
    """(V,) residuals less the views' own parameters."""
    known: int
    """S"""
    places: dict[str, slice]
    """Of each change's columns, by its name."""
    spreads: dict[str, Array]
    """(k,) prior standard deviation of each change's parameters, over their scales."""
    sigma: float
    """px per axis"""

    @staticmethod
    def of(
        known: Known,
        changes: Sequence[Effect],
        observations: Observations,
        poses: Tensor,
        at: Values | None = None,
    ) -> Equations:
        """Linearised at the calibration's values, or at others, and (V, B) own parameters. A change
        that the calibration has as an effect is one of it.
        """
        parameters, new = widened(known, changes)
        parameters = replace(parameters, origin={**parameters.origin, **(at or {})})
        path = known.model.with_effects(new).path
        entries = {
            change.name: parameters.entries(u.param.name for u in change.effect_parameters)
            for change in changes
        }
        columns = np.concatenate([np.zeros(0, np.int64), *entries.values()])
        products, freedom = [], []
        for view in view_equations(path, parameters, observations, poses, known.sigma):
            rows = np.column_stack(
                [
                    view.residual,
                    view.jacobian_shared[:, : len(known.root)] @ known.root,
                    view.jacobian_shared[:, columns],
                ]
            )
            basis = orthonormal_basis(view.jacobian_block)
            inside = basis.T @ rows
            products.append(rows.T @ rows - inside.T @ inside)
            freedom.append(int(np.count_nonzero(view.jacobian_block.any(1))) - basis.shape[1])
        ends = 1 + len(known.root) + np.cumsum([0, *(len(own) for own in entries.values())])
        places = {
            name: slice(int(first), int(last))
            for name, first, last in zip(entries, ends, ends[1:], strict=False)
        }
        size = 1 + len(known.root) + len(columns)
        return Equations(
            np.array(products).reshape(-1, size, size),
            np.array(freedom, dtype=np.float64),
            len(known.root),
            places,
            {change.name: spread_of(change) for change in changes},
            known.sigma,
        )

    def predicted(self, views: slice | NDArray[np.int64] = slice(None)) -> Array:
        """(n, n) inner products in the metric V^-1 of these views together: residual first, then
        changes.
        """
        products, inner = self.products[views].sum(0), slice(1, 1 + self.known)
        outside = self._outside(products)
        across = products[outside, inner]
        spread = np.eye(self.known) + products[inner, inner]
        return np.asarray(
            products[np.ix_(outside, outside)] - across @ np.linalg.solve(spread, across.T)
        )

    def log_determinant(self, views: NDArray[np.int64]) -> float:
        """Of V of these views together."""
        inner = slice(1, 1 + self.known)
        return float(
            np.linalg.slogdet(np.eye(self.known) + self.products[views].sum(0)[inner, inner])[1]
        )

    def left_out(self, view: int) -> tuple[Array, float]:
        """The same of a view that the calibration was fitted to, against what the other views say,
        and the freedom of its residual.

        Its fit is undone, to first order: in-sample, a residual is V^-1 times what it is against a
            fit without it, with V of that fit's
        covariance.
        """
        products, inner = self.products[view], slice(1, 1 + self.known)
        values, axes = np.linalg.eigh(np.eye(self.known) - products[inner, inner])
        told = values > LEAST_LEFT
        outside = self._outside(products)
        whole = products[np.ix_(outside, outside)].copy()
        across = products[outside, inner]
        whole[1:, 1:] -= across[1:] @ across[1:].T
        whole[0, 0] += float(((across[0] @ axes[:, told]) ** 2 / values[told]).sum())
        return whole, float(self.freedom[view] - np.count_nonzero(~told))

    def _outside(self, products: Array) -> NDArray[np.int64]:
        return np.array([0, *range(1 + self.known, len(products))])

    def columns(self, name: str) -> slice:
        """Where a change stands in `predicted` and `left_out`."""
        place = self.places[name]
        return slice(place.start - self.known, place.stop - self.known)

    @property
    def spared(self) -> Array:
        """(V,) by how much what the calibration does not know adds to each view's expected sum of
        squares.
        """
        inner = slice(1, 1 + self.known)
        return np.asarray(np.trace(self.products[:, inner, inner], axis1=1, axis2=2))


def widened(known: Known, changes: Sequence[Effect]) -> tuple[Parameters, list[Effect]]:
    """The known parameters, then those of changes where they are neutral; and the changes that the
    calibration has not as effects.
    """
    there = {effect.name for effect in known.model.effects}
    new = [change for change in changes if change.name not in there]
    wider = known.model.with_effects(new)
    neutral = {
        name: value for effect in new for name, value in known.model.neutral_values(effect).items()
    }
    own = known.parameters
    free = (*own.free, *(u.param for effect in new for u in effect.effect_parameters))
    return Parameters({**own.origin, **neutral}, own.relief, free, wider.priors), new


def spread_of(change: Effect) -> Array:
    """(k,) the prior standard deviation of each of its parameters, over its scale."""
    each = (
        np.broadcast_to(np.asarray(u.sigma, np.float64) / u.param.scale, u.param.shape).ravel()
        for u in change.effect_parameters
    )
    return np.concatenate([np.zeros(0), *each])
