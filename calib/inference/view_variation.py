"""Numbers that differ from view to view: random effects over the views, at the optimum of a fit,
without a further fit.

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
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import DEGREES as PRINT_DEGREES
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES as BEND_DEGREES
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect, EffectContext
from calib.effects.lens import LensEffect
from calib.effects.registry import EFFECTS, OF_VIEW
from calib.effects.rolling_shutter import RollingShutter
from calib.effects.varying import Varying
from calib.estimation.camera_model import CameraModel
from calib.estimation.normal_equations import ReducedProducts
from calib.estimation.objective import view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.view_equations import view_equations
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import LaplaceEvidence
from calib.inference.model_discrepancy import Discrepancy, possible_gain
from calib.inference.score_test import tuned_score_tests
from calib.inference.varying_numbers import (
    MIN_BLOCK,
    Group,
    VariationKind,
    centred_pattern,
    groups_of,
    patterns_of,
)
from calib.optics.board_target import MOTION, block_columns
from calib.optics.relief import AMPLITUDES
from calib.session.tolerances import (
    BOARD_MOVE,
    BOARD_SPIN,
)

SPREADS = 10.0 ** np.arange(-3.0, 0.01, 0.125)
"""The spreads that are tried, in tolerances: from a thousandth to one."""
MAX_DEVIATION = 3.0
"""Tolerances, root mean square: numbers that differ by more are not possible."""
MOTIONS = ((1.0, 0.0), (1.0, 0.1), (1.0, 0.3), (1.0, 1.0), (0.3, 1.0), (0.1, 1.0), (0.0, 1.0))
"""Ratios of the spreads of a board's turn and move, each over its tolerance."""
MIN_PRECISION = 1e-12
"""The smallest prior precision, over the largest, of an axis that has a prior."""
MAX_PASSES = 5
"""The largest number of passes over the views that move one view to the other kind."""
MAX_REFINED = 4
"""The number of variations that the heights of a discrepancy are chosen beside."""
MIN_GAIN = 7.0
"""The smallest gain in log evidence that is reported: some sixty variations are tried."""
MIN_VIEWS = 8
"""The fewest views of which it is asked."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Variation:
    """A way in which a group of numbers may differ from view to view."""

    group: Group
    kind: VariationKind
    gain: float
    """The increase of the log evidence, less `penalty`."""
    scales: Array
    """(G,) the standard deviations of the numbers' deviations, in tolerances."""
    deviations: Array
    """(V, G) the deviations of each view's numbers, in tolerances."""
    pattern: Array
    """(V,) what the deviations of all numbers follow; (0,) if every view has its own."""
    penalty: float = 0.0
    """The logarithm of the number of variants tried."""
    view_log_likelihoods: Array = field(default_factory=lambda: np.zeros(0))
    """(V,) log likelihood of each view's corners with it, up to a constant; (0,) if not asked."""

    @property
    def largest(self) -> float:
        """The root mean square of the deviations of the number that deviates most, in
        tolerances.
        """
        return float(np.sqrt((self.deviations**2).mean(0)).max())

    def effects(self, context: EffectContext) -> tuple[Effect, ...]:
        """Return the effect that adds these deviations to a model; none if there is none. A board
        whose bend differs gets one of its own in every view.
        """
        name = self.group.name
        flexes = name == BoardFlex.name and VariationKind.EACH in self.group.kinds
        each = flexes or self.kind is VariationKind.EACH
        for kind in (*EFFECTS, *OF_VIEW):
            if each and kind.varies and kind.name == name:
                return kind.propose(context)
        if name in (BoardScale.name, BoardFlex.name):
            return ()
        # The maps are of the state at the end, which the next picture has, or of the mean.
        ends = {VariationKind.STEP: self.pattern.max(), VariationKind.WARM_UP: self.pattern.min()}
        pattern = self.pattern - ends.get(self.kind, 0.0)
        return (Varying(name, self.kind.varies, self.group.number_names, tuple(pattern.tolist())),)

    def penalised(self, penalty: float) -> Variation:
        """Return the best of several variants with the penalty for trying them."""
        return replace(self, gain=self.gain - penalty, penalty=penalty)


def find_variations(
    fitted: FittedModel, context: EffectContext, shared: Sequence[type[Effect]] = ()
) -> list[Variation]:
    """Return what differs from view to view, the most probable first.

    If a model lacks something in single views, any numbers of single views imitate it. So the gain
    of a variation is its increase of the log evidence over a model with a discrepancy of no cause
    (calib.inference.model_discrepancy), whose heights are chosen again beside the variation.

    Args:
        fitted: a model at its optimum.
        shared: kinds of effects that all views share, which explain what they can where the model
            lacks them.
    """
    if largest_gain(fitted, context) < MIN_GAIN:
        return []
    groups, patterns = _groups(fitted, context), patterns_of(fitted)
    present = {effect.name for effect in fitted.model.effects}
    proposals = [
        effect for kind in shared if kind.name not in present for effect in kind.propose(context)
    ]
    effects = [test.effect for test in tuned_score_tests(fitted, proposals)]
    rows = VariationRows.of(fitted.with_neutral(effects), context)
    alone = VariationEquations.of(rows)
    discrepancy = rows.discrepancy(alone.solution)
    with_discrepancy = VariationEquations.of(rows, discrepancy)
    without = alone.log_evidence + possible_gain(with_discrepancy.log_evidence - alone.log_evidence)
    has_discrepancy = with_discrepancy.log_evidence > alone.log_evidence
    candidates = []
    variations = zip(
        alone.variations(groups, patterns),
        with_discrepancy.variations(groups, patterns),
        strict=True,
    )
    for index, (first, second) in enumerate(sorted(variations, key=lambda pair: -pair[0].gain)):
        evidence_with_discrepancy = with_discrepancy.log_evidence + second.gain
        if index < MAX_REFINED and first.gain > MIN_GAIN:
            evidence_with_discrepancy = max(
                evidence_with_discrepancy, alone.log_evidence_beside(first)
            )
        evidence = alone.log_evidence + first.gain
        evidence += possible_gain(evidence_with_discrepancy - evidence)
        likelihoods = (
            with_discrepancy.view_log_likelihoods(second)
            if has_discrepancy
            else alone.view_log_likelihoods(first)
        )
        candidates.append(replace(first, gain=evidence - without, view_log_likelihoods=likelihoods))
    candidates = [
        variation
        for variation in candidates
        if variation.gain > MIN_GAIN and variation.largest < MAX_DEVIATION
    ]
    return sorted(candidates, key=lambda variation: -variation.gain)


def largest_gain(fitted: FittedModel, context: EffectContext) -> float:
    """Return the largest increase of the log evidence by numbers that differ from view to view,
    over the model as it is; 0 for few views.
    """
    if len(fitted.observations.names) < MIN_VIEWS:
        return 0.0
    return _with_largest_gain(fitted, context)[1]


def largest_log_evidence(fitted: FittedModel, context: EffectContext) -> float:
    """Return the log evidence of a model, with its noise chosen again, beside the numbers that
    differ from view to view most probably. It compares models of the same views and of the same
    parameters of views, fitted with the same noise.
    """
    equations, gain = _with_largest_gain(fitted, context)
    return equations.log_evidence + max(0.0, gain)


def log_evidence_beside_discrepancy(fitted: FittedModel, context: EffectContext) -> float:
    """Return the log evidence of a model in px, with its noise chosen again, beside the most
    probable discrepancy. It compares models of the same views and of the same parameters of views.
    """
    rows = VariationRows.of(fitted, context)
    discrepancy = rows.discrepancy(VariationEquations.of(rows).solution)
    evidence = VariationEquations.of(rows, discrepancy).log_evidence
    return evidence - sum(len(view) for view in rows.views) * float(np.log(fitted.joint.sigma))


def _with_largest_gain(
    fitted: FittedModel, context: EffectContext
) -> tuple[VariationEquations, float]:
    equations = VariationEquations.of(VariationRows.of(fitted, context))
    variations = equations.variations(_groups(fitted, context), patterns_of(fitted))
    return equations, max((variation.gain for variation in variations), default=0.0)


def _groups(fitted: FittedModel, context: EffectContext) -> list[Group]:
    """Return the groups of numbers of which the model does not say yet that they differ. Views
    cannot have both a focal length and a principal point of their own.
    """
    varying = {effect.name for effect in fitted.model.effects if effect.varies}
    groups = [group for group in groups_of(context) if group.name not in varying]
    if context.path.camera_block:
        of_view = {kind.name for kind in OF_VIEW}
        groups = [group.without_each() if group.name in of_view else group for group in groups]
    return groups


@dataclass(frozen=True, eq=False)
class VariationRows:
    """The linearised residuals of all views by their own parameters, by the shared parameters, and
    by every number that may differ.
    """

    views: tuple[Array, ...]
    """(2m, B + n + 1) for each view, over the noise of the fit: its own parameters, n columns, and
    the residual with all parameters at their prior means.
    """
    own_precision: Tensor
    """(B,) the prior precision of the views' own parameters; 0 without a prior."""
    precision: Array
    """(S, S) prior precision of the shared parameters."""
    shared: NDArray[np.int64]
    """(S,) their places among the n columns."""
    motion: int
    """The number of columns of a board's motion, the first ones: 6, or 0 if the model has it."""
    entries: Mapping[str, tuple[int, float, float]]
    """For each number: its place, its scale and its value."""
    observations: Observations

    @staticmethod
    def of(fitted: FittedModel, context: EffectContext) -> VariationRows:
        """Linearise around a fit."""
        base = fitted.model
        full = _completed(base.with_effects(_probes(base, context)))
        values = {**full.means, **fitted.joint.values}
        held = {
            param.name: 1.0
            for param in full.path.params
            if param.name in values  # not those that an effect computes from its own
            and param.name not in full.priors.sigmas
            and param.name != AMPLITUDES
        }
        parameters = Parameters.of(full.path, values, full.priors.with_sigmas(held))
        estimated = Parameters.of(base.path, values, base.priors)
        blocks = block_columns(full.path.view_blocks)
        own_columns = np.concatenate([np.r_[blocks[block]] for block in base.path.view_blocks])
        motion_columns = np.arange(0) if base.path.shutter else np.r_[blocks[MOTION]]
        columns = parameters.entries(estimated.slices())
        own_precision = view_precision(base.path, fitted.joint.poses)
        poses = full.pad_poses(fitted.joint.poses)
        equations = view_equations(
            full.path, parameters, fitted.observations, poses, fitted.joint.sigma
        )
        views = []
        for view, pose in zip(equations, fitted.joint.poses.numpy(), strict=True):
            block = view.jacobian_block[:, own_columns]
            at_prior_means = block @ (pose * (own_precision.numpy() > 0))
            at_prior_means += view.jacobian_shared[:, columns] @ fitted.deviation
            columns_left = view.jacobian_block[:, motion_columns], view.jacobian_shared
            views.append(np.column_stack([block, *columns_left, view.residual - at_prior_means]))
        scales = [1.0] * parameters.amplitudes + parameters.scales.tolist()
        return VariationRows(
            views=tuple(views),
            own_precision=own_precision,
            precision=estimated.prior_precision(fitted.joint.smoothness),
            shared=len(motion_columns) + columns,
            motion=len(motion_columns),
            entries={
                name: (len(motion_columns) + place.start, scales[place.start], float(values[name]))
                for name, place in parameters.slices().items()
                if not values[name].ndim
            },
            observations=fitted.observations,
        )

    @property
    def own(self) -> int:
        """The number of parameters of each view."""
        return len(self.own_precision)

    @property
    def prior_precisions(self) -> Array:
        """The prior precisions of the shared parameters, along the axes that have one."""
        sizes = np.linalg.eigvalsh(self.precision)
        return np.asarray(sizes[sizes > MIN_PRECISION * sizes.max(initial=0.0)])

    def columns(self, group: Group) -> Array:
        """Return (n + 1, G) the deviations of a group's numbers, over their tolerances, in terms of
        the columns.
        """
        count = self.views[0].shape[1] - self.own
        if not group.numbers:
            columns = np.zeros((count, self.motion))
            columns[: self.motion] = np.diag([BOARD_SPIN.sigma] * 3 + [BOARD_MOVE.sigma] * 3)
            return columns
        columns = np.zeros((count, len(group.numbers)))
        for index, number in enumerate(group.numbers):
            for name in number.shifts:
                column, scale, value = self.entries[name]
                change = value if number.relative else 1.0
                columns[column, index] = number.sigma * change / scale
        return columns

    def discrepancy(self, solution: Array, variation: Variation | None = None) -> Discrepancy:
        """Return the most probable discrepancy, with the shared parameters held at a (S,) solution:
        that with all parameters takes a hundred times as long.

        Args:
            variation: numbers that differ beside it: of each view's own, or as estimated.
        """
        has_own = variation is not None and not variation.pattern.size
        views = []
        for index, rows in enumerate(self.views):
            block, columns_left = rows[:, : self.own], rows[:, self.own :]
            residual = columns_left[:, -1] + columns_left[:, self.shared] @ solution
            if variation:
                differing = columns_left @ self.columns(variation.group)
                if has_own:
                    block = np.column_stack([block, differing * variation.scales])
                else:
                    residual = residual + differing @ variation.deviations[index]
            views.append(torch.from_numpy(np.column_stack([block, residual])))
        evidence = LaplaceEvidence(tuple(views), torch.zeros(0, 0, dtype=torch.float64))
        added = views[0].shape[1] - 1 - self.own
        own_precision = torch.cat([self.own_precision, self.own_precision.new_ones(added)])
        return Discrepancy.of(evidence, self.observations, own_precision)


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
        products = []
        log_determinant = 0.0
        for index, view in enumerate(rows.views):
            inner, eliminated = (
                discrepancy.eliminate(index, view) if discrepancy else (view.T @ view, 0.0)
            )
            reduced = ReducedProducts.of(torch.from_numpy(inner)[None], rows.own_precision)
            products.append(reduced.products[0].numpy())
            log_determinant += eliminated + float(reduced.log_determinant)
        return VariationEquations(rows, np.array(products), log_determinant)

    @property
    def freedom(self) -> int:
        """The number of residuals minus that of the views' own parameters."""
        return sum(len(view) for view in self.rows.views) - self.rows.own * len(self.products)

    def variations(
        self, groups: Sequence[Group], patterns: Mapping[VariationKind, Sequence[Array]]
    ) -> list[Variation]:
        """Return the most probable variation of every kind of every group."""
        return [
            variation for group in groups for variation in self.group(group).variations(patterns)
        ]

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
        return np.asarray(np.linalg.solve(self._root, cross))

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
        """(S, S) lower Cholesky factor of the information about the shared parameters."""
        return np.asarray(np.linalg.cholesky(self._reduced[:-1, :-1]))

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

    def view_log_likelihoods(self, variation: Variation) -> Array:
        """Return (V,) the log likelihoods of the views' corners with the deviations of a variation,
        up to a constant, with the noise that these leave.
        """
        places = variation.deviations @ self.rows.columns(variation.group).T  # (V, n + 1)
        places[:, self.rows.shared] += self.solution_with(variation)
        places[:, -1] = 1.0
        costs = np.einsum("vi,vij,vj->v", places, self.products, places)
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


def _probes(model: CameraModel, context: EffectContext) -> list[Effect]:
    """Return effects whose parameters may differ from view to view and that the model lacks."""
    present = {effect.name for effect in model.effects}
    half = context.board.half
    probes: list[Effect] = [LensEffect(), BoardShape(*half), BoardScale(True, half=half)]
    if not model.path.shutter:
        probes.append(RollingShutter())
    return [probe for probe in probes if probe.name not in present]


def _completed(model: CameraModel) -> CameraModel:
    """Return the model with the terms of its board that may differ: of zero, if it had none."""
    target = model.path.target
    prints = [
        replace(print_, sheared=True, degree=max(print_.degree, PRINT_DEGREES[0]))
        if isinstance(print_, BoardScale)
        else print_
        for print_ in target.prints
    ]
    bends = [
        replace(bend, degree=max(bend.degree, BEND_DEGREES[1]))
        if isinstance(bend, BoardShape)
        else bend
        for bend in target.bends
    ]
    target = replace(target, prints=tuple(prints), bends=tuple(bends))
    zeros = {param.name: torch.zeros((), dtype=torch.float64) for param in target.params}
    return replace(model, path=replace(model.path, target=target), means={**zeros, **model.means})


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
        in_every_view = self.in_every_view()
        if VariationKind.EACH in self.group.kinds:
            yield in_every_view
        for kind in self.group.kinds:
            followed = [self.following(kind, pattern) for pattern in patterns.get(kind, ())]
            if followed:
                best = max(followed, key=lambda variation: variation.gain)
                yield best.penalised(float(np.log(len(followed))))
        if VariationKind.TWO_KINDS in self.group.kinds:
            yield self.in_two_kinds(in_every_view.deviations)

    def in_every_view(self) -> Variation:
        """Return the variation with deviations of each view's own."""
        sides = [np.ones(self.size)]
        if not self.group.numbers:
            sides = [np.repeat(ratio, 3) for ratio in MOTIONS]
        fitted = [(*self._of_each(side), side) for side in sides]
        gain, spread, deviations, side = max(fitted, key=lambda fit: fit[0])
        sizes = (np.tile(side, self.count) * deviations).reshape(self.count, -1)
        return Variation(self.group, VariationKind.EACH, gain, spread * side, sizes, np.zeros(0))

    def _of_each(self, side: Array) -> tuple[float, float, Array]:
        sides = np.tile(side, self.count)
        return self._largest_gain(sides[:, None] * self.information * sides, sides * self.score)

    def gain(self, variation: Variation) -> float:
        """Return the gain in log evidence of a variation like this one, of the same kind and
        pattern, with the spread of this fit.
        """
        if variation.pattern.size:
            return self.following(variation.kind, variation.pattern).gain - variation.penalty
        return self._of_each(variation.scales / variation.scales.max())[0]

    def in_two_kinds(self, deviations: Array) -> Variation:
        """Return the variation of two kinds of views, from a start: (V, G) deviations of each
        view's own, which differ most between the kinds.
        """
        divisions = (
            self.following(VariationKind.TWO_KINDS, pattern) for pattern in _divisions(deviations)
        )
        best = max(divisions, key=lambda variation: variation.gain)
        for _ in range(MAX_PASSES):
            previous = best
            for view in range(self.count):
                moved = best.pattern > 0
                moved[view] = not moved[view]
                if min(moved.sum(), (~moved).sum()) >= MIN_BLOCK:
                    flipped = self.following(VariationKind.TWO_KINDS, centred_pattern(moved))
                    best = max(best, flipped, key=lambda variation: variation.gain)
            if best is previous:
                break
        return best.penalised((self.count - 1) * float(np.log(2)))

    def following(self, kind: VariationKind, pattern: Array) -> Variation:
        """Return the variation whose deviations follow a (V,) pattern."""
        views = np.kron(pattern[:, None], np.eye(self.size))  # (V G, G)
        gain, spread, sizes = self._largest_gain(
            views.T @ self.information @ views, views.T @ self.score
        )
        scales = np.full(self.size, spread)
        return Variation(self.group, kind, gain, scales, pattern[:, None] * sizes, pattern)

    def _largest_gain(self, information: Array, score: Array) -> tuple[float, float, Array]:
        """Return the largest gain in log evidence by (k,) deviations of one spread, that spread,
        and the deviations.
        """
        sizes, axes = np.linalg.eigh(information)
        sizes = sizes.clip(0)
        projected = axes.T @ score
        variance = SPREADS[:, None] ** 2
        explained = (variance * projected**2 / (1 + variance * sizes)).sum(1)
        log_ratio = np.log1p(-np.minimum(explained / self.cost, 1 - 1e-12))
        gains = -(np.log1p(variance * sizes).sum(1) + self.freedom * log_ratio) / 2
        best = int(gains.argmax())
        squared = float(variance[best, 0])
        deviations = -axes @ (squared * projected / (1 + squared * sizes))
        return float(gains[best]), float(SPREADS[best]), deviations


def _divisions(deviations: Array) -> Iterator[Array]:
    """Yield (V,) patterns of two kinds of views, which differ most in their (V, G) deviations."""
    centred = deviations - deviations.mean(0)
    projected = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    order = projected.argsort(kind="stable").argsort()
    for count in range(MIN_BLOCK, len(projected) - MIN_BLOCK + 1):
        yield centred_pattern(order >= count)
