"""The evidence of numbers that differ from view to view: random effects over the views, at the
optimum of a fit, without a further fit.

A lens that refocuses, a sensor that warms up, or a cover that slips gives every view numbers of its
own, or two kinds of views, or a drift. For each group of numbers, the deviations are normal, with
one spread in the group's own tolerances. The evidence is maximised over the spread and the noise,
with the poses and the shared parameters integrated out, so groups and kinds compare directly.

With A the information of all views' deviations and b their score, both after the elimination of
everything else, and c the sum of squares without them, a spread s changes twice the log evidence by
-log det(I + s^2 A) - f log(1 - s^2 b^T (I + s^2 A)^-1 b / c), with f degrees of freedom.

Sources: N. M. Laird, J. H. Ware, Random-effects models for longitudinal data (1982); R. E. Kass,
    A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded, lapack, solve_triangular

from calib.estimation.normal_equations import ReducedProducts
from calib.inference.model_discrepancy import Discrepancy
from calib.inference.variation import Variation
from calib.inference.variation_rows import VariationRows
from calib.inference.varying_numbers import MIN_BLOCK, Group, VariationKind, centred_pattern

SPREADS = 10.0 ** np.arange(-3.0, 0.01, 0.125)
"""The spreads that are tried, in tolerances: from a thousandth to one."""
MOTIONS = ((1.0, 0.0), (1.0, 0.1), (1.0, 0.3), (1.0, 1.0), (0.3, 1.0), (0.1, 1.0), (0.0, 1.0))
"""Ratios of the spreads of a board's turn and move, each over its tolerance."""
ROUNDING = 1e-10
"""The part of a column's information that rounding errors may take."""
MIN_TRIDIAGONAL = 200
"""The size of a matrix from which its tridiagonal form is faster than its eigenvectors."""
MAX_PASSES = 5
"""The largest number of passes over the views that move one view to the other kind."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VariationEquations:
    """The linearised residuals of all views, with their own parameters eliminated."""

    rows: VariationRows
    products: Array
    """(V, n + 1, n + 1) inner products of each view's n columns and its residual."""
    log_determinant: float
    """The log determinant of all that was eliminated."""

    @staticmethod
    def of(rows: VariationRows, discrepancy: Discrepancy | None = None) -> VariationEquations:
        """Eliminate the views' own parameters, and a discrepancy."""
        eliminated = 0.0
        size = rows.views[0].shape[1] - rows.own
        products = np.empty((len(rows.views), size, size))
        for index, (view, inner) in enumerate(zip(rows.views, rows.products, strict=True)):
            remaining = inner
            if discrepancy:
                explained, log_determinant = discrepancy.explain(index, view)
                remaining = inner - explained
                eliminated += log_determinant
            reduced = ReducedProducts.of(torch.from_numpy(remaining[None]), rows.own_precision)
            products[index] = reduced.products[0].numpy()
            eliminated += float(reduced.log_determinant)
        return VariationEquations(rows, products, eliminated)

    @property
    def freedom(self) -> int:
        """The number of residuals minus that of the views' own parameters."""
        return sum(len(view) for view in self.rows.views) - self.rows.own * len(self.products)

    def variations(
        self, groups: Sequence[Group], patterns: Mapping[VariationKind, Sequence[Array]]
    ) -> Iterator[Variation]:
        """Yield the most probable variation of every kind of every group."""
        for group in groups:
            yield from self.group(group).variations(patterns)

    def log_evidence_beside(self, variation: Variation) -> float:
        """Return the log evidence with a variation and with the most probable discrepancy beside
        it.
        """
        discrepancy = self.rows.discrepancy(self.solution_with(variation), variation)
        equations = VariationEquations.of(self.rows, discrepancy)
        return equations.log_evidence + equations.group(variation.group).gain(variation)

    def group(self, group: Group) -> GroupEquations:
        """Return the equations of the deviations of one group's numbers."""
        columns = self.rows.columns(group)
        moved = self.products @ columns  # (V, n + 1, G)
        diagonal = columns.T @ moved
        count, size = diagonal.shape[:2]
        response = self._response(moved)
        information = -response.T @ response
        for view in range(count):
            place = slice(view * size, (view + 1) * size)
            information[place, place] += diagonal[view]
        score = moved[:, -1].ravel() - response.T @ self._whitened
        return GroupEquations(group, information, score, self._cost, self.freedom, size)

    def _response(self, moved: Array) -> Array:
        """Return (S, V G) the whitened coupling of the shared parameters to the deviations of the
        numbers of (V, n + 1, G) products.
        """
        count, _, size = moved.shape
        cross = moved[:, self.rows.shared].transpose(1, 0, 2).reshape(-1, count * size)
        return np.asarray(solve_triangular(self._root, cross, lower=True))

    @cached_property
    def _reduced(self) -> Array:
        """(S + 1, S + 1): the inner products of the shared parameters' columns and the residual,
        over all views, with the prior.
        """
        chosen = [*self.rows.shared, -1]
        reduced = self.products.sum(0)[np.ix_(chosen, chosen)]
        reduced[:-1, :-1] += self.rows.precision
        return np.asarray(reduced)

    @cached_property
    def _root(self) -> Array:
        """(S, S) lower Cholesky factor of the information about the shared parameters. What no view
        determines may be indefinite by rounding errors, and gets a little information.
        """
        information = self._reduced[:-1, :-1]
        try:
            return np.asarray(np.linalg.cholesky(information))
        except np.linalg.LinAlgError:
            added = np.diag(ROUNDING * information.diagonal())
            return np.asarray(np.linalg.cholesky(information + added))

    @cached_property
    def _whitened(self) -> Array:
        """(S,) the score of the shared parameters over that factor."""
        return np.asarray(np.linalg.solve(self._root, self._reduced[:-1, -1]))

    @property
    def solution(self) -> Array:
        """The (S,) most probable deviations of the shared parameters from their prior means."""
        return -np.asarray(np.linalg.solve(self._root.T, self._whitened))

    def solution_with(self, variation: Variation) -> Array:
        """Return the same (S,) solution for the deviations of a variation."""
        moved = self.products @ self.rows.columns(variation.group)
        score = self._whitened + self._response(moved) @ variation.deviations.ravel()
        return -np.asarray(np.linalg.solve(self._root.T, score))

    def shift(self, variation: Variation) -> Array:
        """Return (S,) by how much the shared parameters differ from `solution` if a variation is
        true: those of the state of the next picture, or of the mean.
        """
        shift = self.solution_with(variation) - self.solution
        if (view := variation.next_state) is not None:
            columns = self.rows.columns(variation.group)
            shift += (columns @ variation.deviations[view])[self.rows.shared]
        return np.asarray(shift)

    def view_log_likelihoods(self, variation: Variation) -> Array:
        """Return (V,) the log likelihoods of the views' corners with the deviations of a variation,
        up to a constant, with the noise that these leave.
        """
        places = variation.deviations @ self.rows.columns(variation.group).T  # (V, n + 1)
        places[:, self.rows.shared] += self.solution_with(variation)
        places[:, -1] = 1.0
        costs = ((places[:, None] @ self.products)[:, 0] * places).sum(1)
        return np.asarray(-costs / (2 * costs.sum() / self.freedom))

    @property
    def log_evidence(self) -> float:
        """The log evidence without any variation, up to a constant, with the noise that maximises
        it.
        """
        determinant = self.log_determinant + 2 * np.log(self._root.diagonal()).sum()
        determinant -= np.log(self.rows.prior_precisions).sum()
        return -float(determinant + self.freedom * np.log(self._cost)) / 2

    @property
    def _cost(self) -> float:
        """The sum of squares that the shared parameters leave."""
        return float(self._reduced[-1, -1] - self._whitened @ self._whitened)


@dataclass(frozen=True, eq=False)
class GroupEquations:
    """The information about the deviations of one group's numbers in all views, in tolerances,
    after the elimination of everything else.
    """

    group: Group
    information: Array
    """(V G, V G), view by view."""
    score: Array
    """(V G,)"""
    cost: float
    """The sum of squares without any deviation."""
    freedom: int
    """The degrees of freedom of that sum."""
    size: int
    """The number of the group's numbers."""

    @property
    def count(self) -> int:
        """The number of views."""
        return len(self.score) // self.size

    def variations(self, patterns: Mapping[VariationKind, Sequence[Array]]) -> Iterator[Variation]:
        """Yield the most probable variation of each possible kind.

        Args:
            patterns: the (V,) patterns that they may follow.
        """
        if VariationKind.EACH in self.group.kinds:
            yield self.in_every_view
        for kind in self.group.kinds:
            if possible := patterns.get(kind, ()):
                best = self.best_following(kind, np.array(possible))
                yield best.penalised(float(np.log(len(possible))))
        if VariationKind.TWO_KINDS in self.group.kinds:
            yield self.in_two_kinds()

    @cached_property
    def in_every_view(self) -> Variation:
        """The variation with deviations of each view's own."""
        sides = [np.ones(self.size)]
        if not self.group.numbers:
            sides = [np.repeat(ratio, 3) for ratio in MOTIONS]
        fitted = [(*self._of_each(side), side) for side in sides]
        gain, spread, deviations, side = max(fitted, key=lambda fit: fit[0])
        sizes = (np.tile(side, self.count) * deviations).reshape(self.count, -1)
        return Variation(self.group, VariationKind.EACH, gain, spread * side, sizes, np.zeros(0))

    def _of_each(self, side: Array) -> tuple[float, float, Array]:
        """Return the largest gain by deviations of each view's own with spreads of these (G,)
        ratios, their spread, and the (V G,) deviations over the ratios.
        """
        sides = np.tile(side, self.count)
        places = np.flatnonzero(sides)
        chosen = sides[places]
        information = chosen[:, None] * self.information[np.ix_(places, places)] * chosen
        score = chosen * self.score[places]
        gain, spread, sizes = self._largest_gain(information, score)
        deviations = np.zeros(len(sides))
        deviations[places] = sizes
        return gain, spread, deviations

    def _largest_gain(self, information: Array, score: Array) -> tuple[float, float, Array]:
        """Return what `_largest_gains` does for one matrix."""
        if len(score) >= MIN_TRIDIAGONAL:
            with suppress(np.linalg.LinAlgError):  # rounding errors may make it indefinite
                return self._of_many(Tridiagonal.of(information), score)
        (gain,), (spread,), (deviations,) = self._largest_gains(information[None], score[None])
        return float(gain), float(spread), deviations

    def _of_many(self, information: Tridiagonal, score: Array) -> tuple[float, float, Array]:
        """Return what `_largest_gains` does for one large matrix."""
        turned = information.turn(score)
        solutions = [information.solve(spread**2, turned) for spread in SPREADS]
        explained = SPREADS**2 * [turned @ solution for solution, _ in solutions]
        gains = self._gains(np.array([determinant for _, determinant in solutions]), explained)
        best = int(gains.argmax())
        deviations = information.turn(-(SPREADS[best] ** 2) * solutions[best][0], back=True)
        return float(gains[best]), float(SPREADS[best]), deviations

    def gain(self, variation: Variation) -> float:
        """Return the gain in log evidence of a variation like this one, of the same kind and
        pattern, with the spread of this fit.
        """
        if variation.pattern.size:
            return self.following(variation.kind, variation.pattern).gain - variation.penalty
        return self._of_each(variation.scales / variation.scales.max())[0]

    def in_two_kinds(self) -> Variation:
        """Return the variation of two kinds of views, from a start: deviations of each view's own,
        which differ most between the kinds.
        """
        divisions = _divisions(self.in_every_view.deviations)
        best = self.best_following(VariationKind.TWO_KINDS, divisions)
        for _ in range(MAX_PASSES):
            previous = best
            best = self._move_views(best)
            if best is previous:
                break
        return best.penalised((self.count - 1) * float(np.log(2)))

    def _move_views(self, best: Variation) -> Variation:
        """Return the variation of two kinds of views after one pass over the views, of which each
        moves to the other kind if that is more probable.
        """
        view = 0
        while view < self.count:
            moved = (best.pattern > 0) ^ np.eye(self.count, dtype=bool)[view:]
            first_kind = moved.sum(1)
            patterns = centred_pattern(moved)
            gains = self._gains_following(patterns)[0]
            gains[np.minimum(first_kind, self.count - first_kind) < MIN_BLOCK] = -np.inf
            better = np.flatnonzero(gains > best.gain)
            if not better.size:
                break
            best = self.following(best.kind, patterns[better[0]])
            view += int(better[0]) + 1
        return best

    def best_following(self, kind: VariationKind, patterns: Array) -> Variation:
        """Return the most probable variation whose deviations follow one of the (P, V) patterns."""
        return self.following(kind, patterns[self._gains_following(patterns)[0].argmax()])

    def following(self, kind: VariationKind, pattern: Array) -> Variation:
        """Return the variation whose deviations follow a (V,) pattern."""
        (gain,), (spread,), (sizes,) = self._gains_following(pattern[None])
        scales = np.full(self.size, spread)
        return Variation(self.group, kind, float(gain), scales, pattern[:, None] * sizes, pattern)

    def _gains_following(self, patterns: Array) -> tuple[Array, Array, Array]:
        """Return `_largest_gains` of deviations that follow each of the (P, V) patterns."""
        shape = (len(patterns), self.size, self.count, self.size)
        moved = (patterns @ self.information.reshape(self.count, -1)).reshape(shape)
        information = np.einsum("pgvh,pv->pgh", moved, patterns)
        return self._largest_gains(information, patterns @ self.score.reshape(self.count, -1))

    def _largest_gains(self, information: Array, score: Array) -> tuple[Array, Array, Array]:
        """Return (P,) the largest gains in log evidence by (P, k) deviations of one spread, (P,)
        that spread, and the deviations, for each of the (P, k, k) information matrices.
        """
        sizes, axes = np.linalg.eigh(information)
        sizes = sizes.clip(0)
        projected = np.einsum("pij,pi->pj", axes, score)
        variance = SPREADS[:, None] ** 2
        growth = 1 + variance * sizes[:, None]  # (P, spreads, k)
        explained = (variance * projected[:, None] ** 2 / growth).sum(-1)
        gains = self._gains(np.log(growth).sum(-1), explained)
        best = gains.argmax(1)
        squared = variance[best]
        deviations = -np.einsum("pij,pj->pi", axes, squared * projected / (1 + squared * sizes))
        return gains.max(1), SPREADS[best], deviations

    def _gains(self, log_determinant: Array, explained: Array) -> Array:
        """Return the gains in log evidence of deviations, from the log determinant of I + s^2 A and
        the squares that they explain.
        """
        log_ratio = np.log1p(-np.minimum(explained / self.cost, 1 - 1e-12))
        return np.asarray(-(log_determinant + self.freedom * log_ratio) / 2)


@dataclass(frozen=True, eq=False)
class Tridiagonal:
    """A symmetric (N, N) matrix A = Q T Q^T with a tridiagonal T: what is asked of A for many
    spreads costs a third of its eigenvectors.

    Source: G. H. Golub, C. F. Van Loan, Matrix computations (2013), section 8.3.1.
    """

    bands: Array
    """(2, N) diagonal of T, and the one below it."""
    reflectors: Array
    """(N - 1, N - 1) LAPACK's reflectors, whose product is Q without its first row and column."""
    factors: Array
    """(N - 1,) their factors."""

    @staticmethod
    def of(matrix: Array) -> Tridiagonal:
        """Reduce a matrix."""
        size = int(lapack.dsytrd_lwork(len(matrix), lower=1)[0])
        reduced, diagonal, below, factors, _ = lapack.dsytrd(matrix, lower=1, lwork=size)
        bands = np.stack([diagonal, np.append(below, 0.0)])
        return Tridiagonal(bands, np.asfortranarray(reduced[1:, :-1]), factors)

    def turn(self, vector: Array, *, back: bool = False) -> Array:
        """Return (N,) Q^T times a vector; with `back`, Q times it."""
        turned, _, _ = lapack.dormqr(
            "L", "N" if back else "T", self.reflectors, self.factors, vector[1:, None], 64
        )
        return np.append(vector[:1], turned[:, 0])

    def solve(self, variance: float, right: Array) -> tuple[Array, float]:
        """Return the (N,) solution of (I + variance T) x = right, and the log determinant."""
        bands = variance * self.bands
        bands[0] = 1 + bands[0]
        factor = cholesky_banded(bands, lower=True)
        return cho_solve_banded((factor, True), right), 2 * float(np.log(factor[0]).sum())


def _divisions(deviations: Array) -> Array:
    """Return (P, V) patterns of two kinds of views, which differ most in their (V, G)
    deviations.
    """
    centred = deviations - deviations.mean(0)
    projected = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    order = projected.argsort(kind="stable").argsort()
    counts = np.arange(MIN_BLOCK, len(projected) - MIN_BLOCK + 1)
    return centred_pattern(order >= counts[:, None])
