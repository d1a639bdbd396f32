"""The evidence of explanations of how the cameras of a rig disagree, to first order around a fit.

An explanation has numbers that all placements share (fixed), and others that each placement draws
anew (random). With the rig's numbers and the placements, all are integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import log_bayes_factor
from calib.rig.motion_products import MotionProducts

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RandomMotion:
    """Motions of a camera, or bends of the board, that each placement draws anew."""

    columns: slice | NDArray[np.int64]
    """Their columns in the products."""
    root: Array
    """(P, k, k) L with L L^T their covariance in each placement."""
    adapts: bool = True
    """True if half of the corners of a held-out placement may tell its motions; False for an
    uncertainty that no effect explains.
    """


def realign(
    motions: Sequence[RandomMotion], old: MotionProducts, new: MotionProducts
) -> tuple[RandomMotion, ...]:
    """Return random motions of cameras for the products of a later fit, which has more numbers: the
    columns of all motions move by as many.
    """
    further = _first_motion(new) - _first_motion(old)
    return tuple(replace(m, columns=_moved(m.columns, further)) for m in motions)


def _moved(columns: slice | NDArray[np.int64], further: int) -> slice | NDArray[np.int64]:
    if isinstance(columns, slice):
        return slice(columns.start + further, columns.stop + further)
    return columns + further


def _first_motion(products: MotionProducts) -> int:
    """Return the first column of the motions."""
    first: int = min(place.start for place in products.motions.values())
    return first


@dataclass(frozen=True, slots=True, eq=False)
class FixedMotion:
    """Motions, or other changes, by numbers that all placements share."""

    columns: slice | NDArray[np.int64]
    """Their columns in the products."""
    by_number: Array
    """(P, k, f) the motion in each placement by each number."""
    spread: Array
    """(f,) the prior standard deviation of each number, whose mean is zero."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedEstimate:
    """The numbers of a fixed motion."""

    log_evidence: float
    """Relative to the same explanation without them."""
    value: Array
    """(f,)"""
    covariance: Array
    """(f, f)"""


@dataclass(frozen=True, slots=True, eq=False)
class ReducedMotions:
    """The products with the placements and some random motions integrated out."""

    source: MotionProducts
    weights: NDArray[np.float64]
    """(P,) 1 for a placement that counts, else 0."""
    rows: Array
    """(P, k, n) the products of these are what the random motions explain."""
    log_evidence: float
    """Of the residual with the rig's numbers integrated out, up to a constant."""
    hessian_inverse: Array
    """(S, S) covariance of the rig's vector."""
    gradient: Array
    """(S,) half the gradient of the squares by it."""

    @staticmethod
    def of(
        source: MotionProducts,
        random: Sequence[RandomMotion] = (),
        used: NDArray[np.bool_] | None = None,
    ) -> ReducedMotions:
        """Integrate out the placements and random motions.

        Args:
            used: (P,) the placements that count; None for all.
        """
        count = len(source.products)
        weights = np.ones(count) if used is None else used.astype(np.float64)
        rows, log_volumes = explained_rows(source.without_placements, random)
        rows = rows * weights[:, None, None]
        stacked = rows.reshape(-1, rows.shape[-1])
        total = source.total if used is None else source.without_placements[used].sum(0)
        total = total - stacked.T @ stacked
        numbers = source.numbers
        hessian = total[np.ix_(numbers, numbers)] + source.precision
        gradient = total[numbers, -1] + source.precision @ source.vector
        inverse = np.linalg.inv(hessian)
        return ReducedMotions(
            source=source,
            weights=weights,
            rows=rows,
            log_evidence=float(
                (gradient @ inverse @ gradient - np.linalg.slogdet(hessian)[1] - total[-1, -1]) / 2
                - log_volumes @ weights
            ),
            hessian_inverse=inverse,
            gradient=gradient,
        )

    def step(self, motion: FixedMotion | None = None, value: Array | None = None) -> Array:
        """Return the (S,) step of the rig's vector to its most probable value, for (f,) numbers of
        a fixed motion.
        """
        gradient = self.gradient
        if motion is not None and value is not None:
            gradient = gradient + self._products_with(motion)[:, self.source.numbers].sum(0) @ value
        return -self.hessian_inverse @ gradient

    def estimate(self, motion: FixedMotion) -> FixedEstimate:
        """Return the numbers of a fixed motion, and the evidence for it."""
        information, score = self.marginal(motion)
        precision = information + np.diag(motion.spread**-2.0)
        covariance = np.asarray(np.linalg.inv(precision))
        return FixedEstimate(
            log_evidence=log_bayes_factor(information, score, motion.spread),
            value=-covariance @ score,
            covariance=covariance,
        )

    def marginal(self, motion: FixedMotion) -> tuple[Array, Array]:
        """Return the (f, f) information on the numbers of a fixed motion, and their (f,) score,
        with the rig's numbers integrated out.
        """
        moved = self._products_with(motion)
        information = np.einsum("pki,pkj->ij", motion.by_number, moved[:, motion.columns])
        cross = moved[:, self.source.numbers].sum(0)  # (S, f)
        gain = self.hessian_inverse @ cross
        score = moved[:, -1].sum(0) - gain.T @ self.gradient
        return information - cross.T @ gain, score

    def _products_with(self, motion: FixedMotion) -> Array:
        """Return the (P, n, f) products of all columns with a fixed motion by each number."""
        products = self.source.without_placements[:, :, motion.columns] @ motion.by_number
        reduction = self.rows.swapaxes(1, 2) @ (self.rows[:, :, motion.columns] @ motion.by_number)
        return np.asarray(products * self.weights[:, None, None] - reduction)


def explained_rows(products: Array, random: Sequence[RandomMotion]) -> tuple[Array, Array]:
    """Return (P, k, n) rows whose products are what random motions explain of (P, n, n) products,
    and (P,) half the log determinant of the motions' posterior precision over the prior one.
    """
    if not random:
        return np.zeros((len(products), 0, products.shape[-1])), np.zeros(len(products))
    rows = np.concatenate(
        [motion.root.swapaxes(1, 2) @ products[:, motion.columns, :] for motion in random], axis=1
    )
    inner = np.concatenate([rows[:, :, motion.columns] @ motion.root for motion in random], axis=2)
    factor = np.linalg.cholesky(inner + np.eye(inner.shape[-1]))
    log_volumes = np.log(factor.diagonal(axis1=1, axis2=2)).sum(1)
    return np.linalg.solve(factor, rows), log_volumes
