"""Levenberg-Marquardt for nonlinear least squares with a block-sparse Jacobian. The solver knows
vectors only.

It minimises F(x, y_1 ... y_V) = sum_v |r_v(x, y_v)|^2 + x^T P x + sum_v p . y_v^2: every residual
depends on the shared parameters x (a camera's, say) and on the parameters y_v of its own block (a
view's pose). Each step solves the damped Gauss-Newton equations (J^T J + mu diag(J^T J)) step =
-J^T r. Their Hessian is block-arrow: the Schur complement eliminates the blocks, the reduced camera
system of bundle adjustment is solved for x, and back-substitution gives the blocks, so the time
grows linearly with their number. The damping mu follows the gain ratio: the decrease of F over the
decrease that the quadratic model predicts.

In a curved valley, a direction that the views hardly determine, a good step ends on the valley's
wall, and the main reason for the curvature is that the blocks adapt to x. So after every step each
block takes a step of its own at the new x, before the step is judged. These embedded iterations
turn the problem nearly into one of the shared parameters alone. If a step still gains much less
than predicted, it is bent before it is shortened: the second derivative of the residuals along the
step, by differences, gives the geodesic acceleration, which follows the valley.

As in the references, gradient and Hessian are those of F / 2: J^T r and, in the Gauss-Newton
approximation, J^T J.

Sources: J. Nocedal, S. J. Wright, Numerical optimization (2006), sections 10.3 and 4.1, for the
method and its gain ratio; K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least
squares problems (2004), section 3.2, for the update of the damping; B. Triggs et al., Bundle
adjustment: a modern synthesis (2000), section 6.1, for the Schur complement; A. Ruhe, P. A. Wedin,
Algorithms for separable nonlinear least squares problems (1980), and J. H. Hong, C. Zach, A.
Fitzgibbon, Revisiting the variable projection method for separable nonlinear least squares problems
(2017), for the embedded iterations; M. K. Transtrum, J. P. Sethna, Improvements to the
Levenberg-Marquardt algorithm for nonlinear least-squares minimization (2012), for the acceleration.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise, tee
from typing import Protocol

import torch
from torch import Tensor

from calib.estimation.normal_equations import (
    LinearisedBlocks,
    NormalEquations,
    damped,
    normal_equations,
    solve,
)

FIRST_DAMPING = 1e-9
"""The first damping, as a fraction of the diagonal: almost none, because the fits here are nearly
linear.
"""
MIN_RETRY_DAMPING = 1e-5
"""The smallest damping after a step that fails or gains little."""
MAX_TRIES = 12
"""The limit on the lengths that are tried for one step. After 12 tries the damping is
MIN_RETRY_DAMPING * 2^(1 + 2 + ... + 12) = 3e18. A damped step promises at most 2 n / damping of the
cost for n parameters, so finite equations end long before at any tolerance in use.
"""
MAX_CACHED_PIECES = 2
"""The largest number of Jacobian pieces that are kept for a bent step; more would take too much
memory.
"""
STRAIGHT_GAIN = 0.75
"""A step with a smaller gain ratio is bent."""
ROUNDING = 1e-26
"""The cost of exact data, from rounding alone."""


class Outcome(Enum):
    """The way in which a fit ended."""

    CONVERGED = "The fit has converged: no step lowers the error any more."
    STEPS_USED_UP = "The fit was still improving when its steps were used up: allow more steps."
    NOT_FINITE = (
        "The fit ended where the error or its derivatives are not finite, and how sure it is cannot"
        " be said: do not use it; check the cover, camera and board in session.yaml, or free fewer"
        " numbers."
    )
    STUCK = (
        "The fit got stuck: no step lowers the error. The numbers that it started from are too far"
        " off, or camera, cover or board are of another kind."
    )


class Linearisation(Protocol):
    """The linearised rows of a problem at one point."""

    @property
    def equations(self) -> NormalEquations:
        """The normal equations of the rows, without the priors."""
        ...

    def curvature_gradient(self, move: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Return the (V, B) and (S,) products J^T r'' of the Jacobian with the second derivatives
        of the residuals along a (S,) and (V, B) move.
        """
        ...


class Problem(Protocol):
    """A cost to minimise: a sum over rows, plus quadratic priors on the parameters."""

    @property
    def precision(self) -> Tensor:
        """The (S, S) matrix P of the prior's cost x^T P x on the shared parameters x."""
        ...

    @property
    def block_precision(self) -> Tensor:
        """The (B,) vector p of the prior's cost p . y^2 on each block's parameters y; 0 for a
        parameter without a prior.
        """
        ...

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        """Return the sum over rows at (S,) and (V, B) parameters, without the priors; infinity if
        the model fails, which rejects the step.
        """
        ...

    def linearisation(self, shared: Tensor, blocks: Tensor) -> Linearisation:
        """Return the linearised rows at (S,) and (V, B) parameters."""
        ...

    def inner_step(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        """Return (V, B) blocks after one step of each block at fixed (S,) shared parameters, no
        worse than the given ones, and the cost at them, without the priors.
        """
        ...


class RowProblem(Problem, Protocol):
    """A problem that returns its linearised rows (`RowLinearised`)."""

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterable[LinearisedBlocks]:
        """Return rows whose sum of squares has the cost's gradient and approximately its Hessian at
        (S,) and (V, B) parameters: all blocks, some at a time, so that the full Jacobian need not
        fit into memory.
        """
        ...

    def second_derivative_along(
        self,
        pieces: Iterable[LinearisedBlocks],
        shared: Tensor,
        blocks: Tensor,
        move: tuple[Tensor, Tensor],
    ) -> Iterable[Tensor]:
        """Yield, for each of these linearised pieces, the (M, D) second derivatives of the
        residuals along a (S,) and (V, B) move.
        """
        ...


class RowLinearised:
    """The part of a `RowProblem` that makes a `Problem` of it."""

    __slots__ = ()

    def linearisation(self: RowProblem, shared: Tensor, blocks: Tensor) -> Linearisation:
        """Return the linearised rows at (S,) and (V, B) parameters."""
        return RowLinearisation(self, shared, blocks)


@dataclass(frozen=True, slots=True)
class Solution:
    """The result of the solver."""

    outcome: Outcome
    shared: Tensor
    """(S,)"""
    blocks: Tensor
    """(V, B)"""
    cost: float
    """The sum over rows, plus the priors."""
    iterations: int
    """The number of linearisations."""
    equations: NormalEquations
    """The normal equations at the solution, with the prior on the blocks but not the shared one."""


def minimise(
    problem: Problem,
    shared: Tensor,
    blocks: Tensor,
    *,
    steps: int = 50,
    tolerance: float = 1e-10,
    progress: Callable[[int, float], None] | None = None,
) -> Solution:
    """Minimise the problem's cost.

    Args:
        problem: the rows and the prior.
        shared: (S,) start; S may be 0.
        blocks: (V, B) start.
        steps: the limit on linearisations.
        tolerance: the solver stops when a step promises to lower the cost by less than this
        fraction.
        progress: called with the step's number and the cost after each accepted step.

    Raises:
        ValueError: the cost at the start is NaN, so no step can be compared with it.
    """
    with_priors = _WithPriors(problem, problem.precision)
    point = with_priors.point(shared, blocks, problem.cost(shared, blocks))
    if math.isnan(point.cost):
        raise ValueError("the cost at the start is not a number")
    damping = FIRST_DAMPING
    for step in range(1, steps + 1):
        rows, linearisation = with_priors.equations_at(point)
        if not (rows.finite and math.isfinite(point.cost)):
            return point.solution(Outcome.NOT_FINITE, step, rows)
        result = _find_step(with_priors, point, rows, linearisation, damping, tolerance)
        if isinstance(result, Outcome):
            return point.solution(result, step, rows)
        point, damping = result.point, result.next_damping
        del linearisation  # before the next one needs as much memory
        if progress:
            progress(step, point.cost)
    rows, _ = with_priors.equations_at(point)
    outcome = Outcome.STEPS_USED_UP if rows.finite else Outcome.NOT_FINITE
    return point.solution(outcome, steps, rows)


@dataclass(frozen=True, slots=True)
class _Point:
    """Parameters and their cost, with the priors."""

    shared: Tensor
    blocks: Tensor
    cost: float

    def solution(self, outcome: Outcome, iterations: int, rows: NormalEquations) -> Solution:
        return Solution(outcome, self.shared, self.blocks, self.cost, iterations, rows)


@dataclass(frozen=True, slots=True)
class _Step:
    """A step that lowers the cost."""

    point: _Point
    """Where it ends."""
    gain: float
    """The decrease of the cost over the promised one."""
    damping: float

    @property
    def next_damping(self) -> float:
        """The damping of the next step: less after a good step, more after a poor one."""
        damping = max(self.damping, MIN_RETRY_DAMPING) if self.gain < 0.25 else self.damping
        return damping * max(1 / 3, 1 - (2 * self.gain - 1) ** 3)


@dataclass(frozen=True, slots=True)
class _WithPriors:
    """A problem with the cost of its priors."""

    problem: Problem
    precision: Tensor
    """(S, S), that of the problem."""

    def point(self, shared: Tensor, blocks: Tensor, row_cost: float) -> _Point:
        """Return the point with these parameters, from the cost of its rows alone."""
        prior = float(shared @ self.precision @ shared) + float(
            (blocks**2 @ self.problem.block_precision).sum()
        )
        return _Point(shared, blocks, row_cost + prior)

    def moved(self, point: _Point, *moves: tuple[Tensor, Tensor]) -> _Point:
        """Return the point after these moves, and after a step of each block there."""
        shared, blocks = point.shared, point.blocks
        for move in moves:
            shared, blocks = shared + move[0], blocks + move[1]
        return self.point(shared, *self.problem.inner_step(shared, blocks))

    def equations_at(self, point: _Point) -> tuple[NormalEquations, Linearisation]:
        """Return the normal equations with the priors on the blocks, and their linearisation."""
        linearisation = self.problem.linearisation(point.shared, point.blocks)
        rows = linearisation.equations
        block_precision = self.problem.block_precision
        with_prior = replace(
            rows,
            hessian_block=rows.hessian_block + block_precision.diag(),
            gradient_block=rows.gradient_block + block_precision * point.blocks,
        )
        return with_prior, linearisation

    def with_shared_prior(self, rows: NormalEquations, point: _Point) -> NormalEquations:
        """Return the normal equations with the prior on the shared parameters, too."""
        return replace(
            rows,
            hessian_shared=rows.hessian_shared + self.precision,
            gradient_shared=rows.gradient_shared + self.precision @ point.shared,
        )


def _find_step(
    with_priors: _WithPriors,
    point: _Point,
    rows: NormalEquations,
    linearisation: Linearisation,
    damping: float,
    tolerance: float,
) -> _Step | Outcome:
    """Return a step that lowers the cost, with more damping at each try; or how the fit ends."""
    equations = with_priors.with_shared_prior(rows, point)
    cost = point.cost
    growth = 2.0
    promised = math.nan
    for _ in range(MAX_TRIES):
        move = _damped_step(equations, damping)
        promised = -_model_change(equations, *move)
        if promised <= tolerance * cost or cost < ROUNDING:
            # A heavily damped step promises little whatever the gradient.
            return Outcome.CONVERGED if damping <= 1 or cost < ROUNDING else Outcome.STUCK
        end = with_priors.moved(point, move)
        if not (cost - end.cost) / promised > STRAIGHT_GAIN and math.isfinite(promised):
            curvature = linearisation.curvature_gradient(move)
            bent = with_priors.moved(point, move, _acceleration_step(equations, curvature, damping))
            end = bent if bent.cost < end.cost else end
        gain = (cost - end.cost) / promised
        if gain > 0:  # false for a cost that is not finite
            return _Step(end, gain, damping)
        damping = max(damping, MIN_RETRY_DAMPING) * growth
        growth *= 2
    return Outcome.STUCK if math.isfinite(promised) else Outcome.NOT_FINITE


def _damped_step(equations: NormalEquations, damping: float) -> tuple[Tensor, Tensor]:
    """Return the (S,) and (V, B) step: the shared parameters by the Schur complement, then the
    blocks by back-substitution. It is NaN if the damped equations are singular.
    """
    shared = damped(equations.hessian_shared, damping)
    reduced = replace(equations, hessian_shared=shared).eliminate_blocks(damping)
    step = -solve(reduced.hessian, reduced.gradient) if len(shared) else reduced.gradient
    return step, reduced.block_step(step)


def _acceleration_step(
    equations: NormalEquations, gradient: tuple[Tensor, Tensor], damping: float
) -> tuple[Tensor, Tensor]:
    """Return half the geodesic acceleration, the correction of a damped step for the residuals'
    second derivative along it, from its `Linearisation.curvature_gradient`.
    """
    by_block, by_shared = gradient
    return _damped_step(
        replace(equations, gradient_block=by_block / 2, gradient_shared=by_shared / 2), damping
    )


class RowLinearisation:
    """The linearisation of a problem that returns its rows."""

    def __init__(self, problem: RowProblem, shared: Tensor, blocks: Tensor) -> None:
        self._problem = problem
        self._point = shared, blocks
        self._pieces = _CachedPieces(lambda: problem.linearise(shared, blocks))
        self.equations = normal_equations(self._pieces)

    def curvature_gradient(self, move: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        first_pass, second_pass = tee(self._pieces)  # the pieces may be computed again
        curvature = self._problem.second_derivative_along(second_pass, *self._point, move)
        by_block, by_shared = [], torch.zeros_like(self.equations.gradient_shared)
        for piece, bend in zip(first_pass, curvature, strict=True):
            by_shared = by_shared + piece.jacobian_shared.flatten(0, 1).mT @ bend.flatten()
            for first, last in pairwise(piece.starts.tolist()):
                by_block.append(
                    piece.jacobian_block[first:last].flatten(0, 1).mT @ bend[first:last].flatten()
                )
        return torch.stack(by_block), by_shared


class _CachedPieces:
    """An iterable of pieces that keeps them if they are few, and else computes them again in every
    iteration.
    """

    def __init__(self, compute: Callable[[], Iterable[LinearisedBlocks]]) -> None:
        self._compute = compute
        self._cache: list[LinearisedBlocks] = []

    def __iter__(self) -> Iterator[LinearisedBlocks]:
        if self._cache:
            yield from self._cache
            return
        cache: list[LinearisedBlocks] = []
        for count, piece in enumerate(self._compute()):
            cache = [*cache, piece] if count < MAX_CACHED_PIECES else []
            yield piece
        self._cache = cache


def _model_change(equations: NormalEquations, shared: Tensor, blocks: Tensor) -> float:
    """Return the change of the cost that the quadratic model predicts for a step."""
    linear = 2 * (equations.gradient_shared @ shared + (equations.gradient_block * blocks).sum())
    quadratic = (
        torch.einsum("vb,vbc,vc->", blocks, equations.hessian_block, blocks)
        + shared @ equations.hessian_shared @ shared
    )
    mixed = 2 * torch.einsum("vb,vbs,s->", blocks, equations.hessian_cross, shared)
    return float(linear + quadratic + mixed)
