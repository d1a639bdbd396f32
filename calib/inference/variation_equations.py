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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

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
MIN_LOW_RANK = 2
"""The deviations over the shared parameters from which Woodbury's form is faster than
eigenvectors.
"""
MOVED_TOGETHER = 64
"""The number of views of which it is computed at once whether one should move to the other kind."""
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
        group_products = self.products @ columns  # (V, n + 1, G)
        coupling = self._coupling(group_products)
        return GroupEquations(
            group=group,
            diagonal=columns.T @ group_products,
            coupling=coupling,
            score=group_products[:, -1] - self._whitened_score @ coupling,
            cost=self._cost,
            freedom=self.freedom,
        )

    def _coupling(self, group_products: Array) -> Array:
        """Return (V, S, G) the whitened coupling of the shared parameters to the deviations of a
        group's numbers, from the (V, n + 1, G) products of all columns with theirs.
        """
        count, _, size = group_products.shape
        cross = group_products[:, self.rows.shared].transpose(1, 0, 2).reshape(-1, count * size)
        whitened = solve_triangular(self._information_root, cross, lower=True)
        return np.asarray(whitened.reshape(-1, count, size).transpose(1, 0, 2))

    @cached_property
    def _shared_products(self) -> Array:
        """(S + 1, S + 1): the inner products of the shared parameters' columns and the residual,
        over all views, with the prior.
        """
        chosen = [*self.rows.shared, -1]
        reduced = self.products.sum(0)[np.ix_(chosen, chosen)]
        reduced[:-1, :-1] += self.rows.precision
        return np.asarray(reduced)

    @cached_property
    def _information_root(self) -> Array:
        """(S, S) lower Cholesky factor of the information about the shared parameters. What no view
        determines may be indefinite by rounding errors, and gets a little information.
        """
        information = self._shared_products[:-1, :-1]
        try:
            return np.asarray(np.linalg.cholesky(information))
        except np.linalg.LinAlgError:
            added = np.diag(ROUNDING * information.diagonal())
            return np.asarray(np.linalg.cholesky(information + added))

    @cached_property
    def _whitened_score(self) -> Array:
        """(S,) the score of the shared parameters over that factor."""
        return np.asarray(np.linalg.solve(self._information_root, self._shared_products[:-1, -1]))

    @property
    def solution(self) -> Array:
        """The (S,) most probable deviations of the shared parameters from their prior means."""
        return -np.asarray(np.linalg.solve(self._information_root.T, self._whitened_score))

    def solution_with(self, variation: Variation) -> Array:
        """Return the same (S,) solution for the deviations of a variation."""
        coupling = self._coupling(self.products @ self.rows.columns(variation.group))
        change = (coupling @ variation.deviations[:, :, None]).sum(0)[:, 0]
        score = self._whitened_score + change
        return -np.asarray(np.linalg.solve(self._information_root.T, score))

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
        numbers = variation.deviations @ self.rows.columns(variation.group).T  # (V, n + 1)
        numbers[:, self.rows.shared] += self.solution_with(variation)
        numbers[:, -1] = 1.0  # the residual's column counts once
        costs = ((numbers[:, None] @ self.products)[:, 0] * numbers).sum(1)
        return np.asarray(-costs / (2 * costs.sum() / self.freedom))

    @property
    def log_evidence(self) -> float:
        """The log evidence without any variation, up to a constant, with the noise that maximises
        it.
        """
        determinant = self.log_determinant + 2 * np.log(self._information_root.diagonal()).sum()
        determinant -= np.log(self.rows.prior_precisions).sum()
        return -float(determinant + self.freedom * np.log(self._cost)) / 2

    @property
    def _cost(self) -> float:
        """The sum of squares that the shared parameters leave."""
        return float(self._shared_products[-1, -1] - self._whitened_score @ self._whitened_score)


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums of a group's equations over the views of P sets."""

    diagonal: Array
    """(P, G, G)"""
    coupling: Array
    """(P, S, G)"""
    score: Array
    """(P, G)"""

    @staticmethod
    def of(group: GroupEquations, order: NDArray[np.int64]) -> _Sums:
        """Return the (V, ...) sums over the first view, the first two views, and so on."""
        return _Sums(
            group.diagonal[order].cumsum(0),
            group.coupling[order].cumsum(0),
            group.score[order].cumsum(0),
        )

    def take(self, sets: NDArray[np.int64]) -> _Sums:
        """Return the sums over some of the sets."""
        return _Sums(self.diagonal[sets], self.coupling[sets], self.score[sets])


@dataclass(frozen=True, eq=False)
class GroupEquations:
    """The information about the deviations of one group's numbers in all views, in tolerances,
    after the elimination of everything else.
    """

    group: Group
    diagonal: Array
    """(V, G, G) their information if all shared parameters were certain."""
    coupling: Array
    """(V, S, G) the whitened shared parameters' part in it: the (V G, V G) information is the
    diagonal blocks less C^T C, with the (S, V G) coupling C of all views.
    """
    score: Array
    """(V, G)"""
    cost: float
    """The sum of squares without any deviation."""
    freedom: int
    """The degrees of freedom of that sum."""

    @property
    def count(self) -> int:
        """The number of views."""
        return len(self.score)

    @property
    def size(self) -> int:
        """The number of the group's numbers."""
        return int(self.score.shape[1])

    def variations(self, patterns: Mapping[VariationKind, Sequence[Array]]) -> Iterator[Variation]:
        """Yield the most probable variation of each possible kind.

        Args:
            patterns: the (V,) patterns that they may follow.
        """
        if VariationKind.EACH in self.group.kinds:
            yield self.in_every_view
        for kind in self.group.kinds:
            if possible := patterns.get(kind, ()):
                best = self.best_variation_along(kind, np.array(possible))
                yield best.penalised(float(np.log(len(possible))))
        if VariationKind.TWO_KINDS in self.group.kinds:
            yield self.in_two_kinds()

    @cached_property
    def in_every_view(self) -> Variation:
        """The variation with deviations of each view's own."""
        all_ratios = [np.ones(self.size)]
        if not self.group.numbers:  # a motion: its turn and its move have spreads of their own
            all_ratios = [np.repeat(ratio, 3) for ratio in MOTIONS]
        results = [(*self._best_of_each_view(ratios), ratios) for ratios in all_ratios]
        gain, spread, deviations, ratios = max(results, key=lambda result: result[0])
        return Variation(
            group=self.group,
            kind=VariationKind.EACH,
            gain=gain,
            scales=spread * ratios,
            deviations=deviations * ratios,
            pattern=np.zeros(0),
        )

    def _best_of_each_view(self, all_ratios: Array) -> tuple[float, float, Array]:
        """Return the largest gain by deviations of each view's own with spreads of these (G,)
        ratios, their spread, and the (V, G) deviations over the ratios. Numbers whose ratio is 0
        do not deviate.
        """
        chosen = np.flatnonzero(all_ratios)
        ratios = all_ratios[chosen]
        diagonal = self.diagonal[:, chosen[:, None], chosen] * np.outer(ratios, ratios)
        coupling = self.coupling[:, :, chosen] * ratios
        score = self.score[:, chosen] * ratios
        deviations = np.zeros(self.score.shape)
        if score.size > MIN_LOW_RANK * coupling.shape[1]:
            gain, spread, deviations[:, chosen] = self._largest_gain_by_blocks(
                diagonal, coupling, score
            )
            return gain, spread, deviations
        information = _information_of_views(diagonal, coupling)
        (gain,), (spread,), (sizes,) = self._largest_gains(information[None], score.reshape(1, -1))
        deviations[:, chosen] = sizes.reshape(score.shape)
        return float(gain), float(spread), deviations

    def _largest_gain_by_blocks(
        self, diagonal: Array, coupling: Array, score: Array
    ) -> tuple[float, float, Array]:
        """Return what `_largest_gains` does for one matrix that is much larger than the number of
        shared parameters. Its inverse is that of the blocks and a correction of low rank (M. A.
        Woodbury, Inverting modified matrices, 1950), so that the time is linear in the views.
        """
        sizes, axes = np.linalg.eigh(diagonal)
        sizes = sizes.clip(0).ravel()
        projected = (score[:, None] @ axes).ravel()
        low_rank = (coupling @ axes).transpose(1, 0, 2).reshape(-1, score.size)
        determinants, explained, solutions = [], [], []
        for spread in SPREADS:
            growth = 1 + spread**2 * sizes
            weight = spread**2 / growth
            scaled = low_rank * np.sqrt(weight)
            explained_rank = scaled @ scaled.T  # half of the products, because it is symmetric
            root = np.linalg.cholesky((1 + ROUNDING) * np.eye(len(scaled)) - explained_rank)
            correction = solve_triangular(root, low_rank @ (weight * projected), lower=True)
            determinants.append(np.log(growth).sum() + 2 * np.log(root.diagonal()).sum())
            explained.append(weight @ projected**2 + correction @ correction)
            back = solve_triangular(root, correction, lower=True, trans="T")
            solutions.append(weight * (projected + back @ low_rank))
        gains = self._gains(np.array(determinants), np.array(explained))
        best = int(gains.argmax())
        deviations = -(axes @ solutions[best].reshape(*score.shape, 1))[:, :, 0]
        return float(gains[best]), float(SPREADS[best]), deviations

    def gain(self, variation: Variation) -> float:
        """Return the gain in log evidence of a variation like this one, of the same kind and
        pattern, with the spread of this fit.
        """
        if variation.pattern.size:
            return self.variation_along(variation.kind, variation.pattern).gain - variation.penalty
        return self._best_of_each_view(variation.scales / variation.scales.max())[0]

    def in_two_kinds(self) -> Variation:
        """Return the variation of two kinds of views, from a start: deviations of each view's own,
        which differ most between the kinds.
        """
        best = self.variation_along(VariationKind.TWO_KINDS, self._best_division())
        for _ in range(MAX_PASSES):
            previous = best
            best = self._move_views(best)
            if best is previous:
                break
        return best.penalised((self.count - 1) * float(np.log(2)))

    def _best_division(self) -> Array:
        """Return the (V,) pattern of two kinds of views that is most probable among those that
        divide the views in the order of their deviations, along which these differ most.
        """
        deviations = self.in_every_view.deviations
        centred = deviations - deviations.mean(0)
        projected = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
        order = projected.argsort(kind="stable")[::-1]
        counts = np.arange(MIN_BLOCK, self.count - MIN_BLOCK + 1)[::-1]  # those of the first kind
        sums = _Sums.of(self, order)
        gains = self._gains_of_kinds(sums.take(counts - 1), counts)
        chosen = np.zeros(self.count, bool)
        chosen[order[: counts[gains.argmax()]]] = True
        return centred_pattern(chosen)

    def _gains_of_kinds(self, sums: _Sums, counts: NDArray[np.int64]) -> Array:
        """Return (P,) the largest gains of P divisions of the views into two kinds, from the (P,)
        numbers of views of the first kind and the sums over them: the patterns are centred, and
        what is quadratic or linear in them follows from such sums.
        """
        share = counts / self.count
        variance = np.maximum(share * (1 - share), 1e-300)[:, None, None]
        share = share[:, None, None]
        every = self._sums_of_all
        diagonal = ((1 - 2 * share) * sums.diagonal + share**2 * every.diagonal) / variance
        coupling = (sums.coupling - share * every.coupling) / np.sqrt(variance)
        score = (sums.score - share[..., 0] * every.score) / np.sqrt(variance[..., 0])
        information = diagonal - coupling.transpose(0, 2, 1) @ coupling
        return self._largest_gains(information, score)[0]

    @cached_property
    def _sums_of_all(self) -> _Sums:
        """The sums over all views."""
        return _Sums(self.diagonal.sum(0), self.coupling.sum(0), self.score.sum(0))

    def _move_views(self, best: Variation) -> Variation:
        """Return the variation of two kinds of views after one pass over the views, of which each
        moves to the other kind if that is more probable.
        """
        is_first = best.pattern > 0
        first = _Sums(
            self.diagonal[is_first].sum(0),
            self.coupling[is_first].sum(0),
            self.score[is_first].sum(0),
        )
        gain = best.gain
        view = 0
        while view < self.count:
            next_views = np.arange(view, min(view + MOVED_TOGETHER, self.count))
            signs = np.where(is_first[next_views], -1, 1)
            counts = int(is_first.sum()) + signs
            sums = _Sums(
                first.diagonal + signs[:, None, None] * self.diagonal[next_views],
                first.coupling + signs[:, None, None] * self.coupling[next_views],
                first.score + signs[:, None] * self.score[next_views],
            )
            gains = self._gains_of_kinds(sums, counts)
            gains[np.minimum(counts, self.count - counts) < MIN_BLOCK] = -np.inf
            better = np.flatnonzero(gains > gain)
            if not better.size:
                view += len(next_views)
                continue
            index = int(better[0])
            is_first[next_views[index]] ^= True
            first = _Sums(sums.diagonal[index], sums.coupling[index], sums.score[index])
            gain = float(gains[index])
            view += index + 1
        if gain == best.gain:
            return best
        return self.variation_along(best.kind, centred_pattern(is_first))

    def best_variation_along(self, kind: VariationKind, patterns: Array) -> Variation:
        """Return the most probable variation whose deviations follow one of the (P, V) patterns."""
        return self.variation_along(kind, patterns[self._gains_along(patterns)[0].argmax()])

    def variation_along(self, kind: VariationKind, pattern: Array) -> Variation:
        """Return the variation whose deviations follow a (V,) pattern."""
        (gain,), (spread,), (sizes,) = self._gains_along(pattern[None])
        scales = np.full(self.size, spread)
        deviations = pattern[:, None] * sizes
        return Variation(self.group, kind, float(gain), scales, deviations, pattern)

    def _gains_along(self, patterns: Array) -> tuple[Array, Array, Array]:
        """Return `_largest_gains` of deviations that follow each of the (P, V) patterns."""
        diagonal = np.tensordot(patterns**2, self.diagonal, 1)  # (P, G, G)
        coupling = np.tensordot(patterns, self.coupling, 1)  # (P, S, G)
        information = diagonal - coupling.transpose(0, 2, 1) @ coupling
        return self._largest_gains(information, patterns @ self.score)

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


def _information_of_views(diagonal: Array, coupling: Array) -> Array:
    """Return the (V G, V G) information, view by view, of (V, G, G) blocks and their (V, S, G)
    coupling.
    """
    count, size = diagonal.shape[:2]
    low_rank = coupling.transpose(1, 0, 2).reshape(-1, count * size)
    information = -low_rank.T @ low_rank
    blocks = information.reshape(count, size, count, size)
    views = np.arange(count)
    blocks[views, :, views] += diagonal
    return information
