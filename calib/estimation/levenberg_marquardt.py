"""Levenberg-Marquardt for nonlinear least squares whose Jacobian is block-sparse. It knows vectors
only.

Minimises F(x, y_1 ... y_V) = sum_v |r_v(x, y_v)|^2 + x^T P x + sum_v p . y_v^2: every residual
depends on the shared parameters x (a camera's, say) and on the parameters y_v of its own block (a
view's pose). Each step solves the damped Gauss-Newton equations (J^T J + mu diag(J^T J)) step =
-J^T r. Their Hessian is block-arrow: the blocks are eliminated by the Schur complement, the reduced
camera system of bundle adjustment is solved for x, and back-substitution gives the blocks, so that
the time grows linearly with their number. The damping mu follows the gain ratio: how much F fell
over what the quadratic model promised.

Along a curved valley, what many views leave open, a good step lands up the valley's wall, and what
bends the valley is above all how each block adapts. So after every step each block takes one of its
own, at the shared parameters' new place, before the step is judged: embedded iterations, which make
of the problem nearly the one in the shared parameters alone. A step that gains much less than it
promised even so
is bent, before it is shortened: the second derivative of the residuals along it, by differences,
    gives the geodesic acceleration, which
follows the valley.

As in the references, gradient and Hessian are those of F / 2: J^T r and, in the Gauss-Newton
approximation, J^T J.

Sources: J. Nocedal, S. J. Wright, Numerical optimization (2006), sections 10.3 and 4.1, for the
    method and its gain ratio; K. Madsen,
H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004), section 3.2, for
the update of the damping; B. Triggs et al., Bundle adjustment: a modern synthesis (2000), section
6.1, for the Schur complement; A. Ruhe, P. A. Wedin, Algorithms for separable nonlinear least
squares problems (1980), and J. H. Hong, C. Zach, A. Fitzgibbon, Revisiting the variable projection
method for separable nonlinear least squares problems (2017), for the embedded iterations; M. K.
Transtrum, J. P. Sethna, Improvements to the Levenberg-Marquardt algorithm for nonlinear
least-squares minimization (2012), for the acceleration.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise, tee
from typing import Protocol

import torch
from torch import Tensor

FIRST_DAMPING = 1e-9
"""Of the diagonal: next to none, for the fits here are nearly linear."""
SMALLEST_HELP = 1e-5
"""Where a step fails or gains little, the damping is at least this."""
TRIES = 12
"""Of a step's length. By then the damping is SMALLEST_HELP * 2^(1 + 2 + ... + 12) = 3e18, and as a
damped step promises at most 2 n / damping of the cost by n parameters, finite equations have ended
long before at any tolerance that is used.
"""
KEPT = 2
"""Pieces of the Jacobian that are kept for a bend: more would be too much memory."""
STRAIGHT = 0.75
"""Of what a step promised: one that gains less is bent."""
ROUNDING = 1e-26
"""A cost that exact data leave."""


class Outcome(Enum):
    """How a fit ended."""

    CONVERGED = "The fit has converged: no step lowers the error any more."
    STEPS_USED_UP = "The fit was still improving when its steps were used up: allow more steps."
    NOT_FINITE = (
        "The fit ended where the error or its derivatives are not finite, and how sure it is cannot"
        " be said: do not use it; check the cover, camera and board in session.yaml, or free fewer"
        " numbers."
    )
    STUCK = (
        "No step of any length lowers the error: the start is too far away, or the model does not"
        " fit these data."
    )


@dataclass(frozen=True, slots=True)
class Linearised:
    """The residuals of some consecutive blocks and their Jacobian at one point, in units of their
    standard deviation, robust weights included.
    """

    starts: Tensor
    """(v + 1,) int64: the rows of the v-th of these blocks are starts[v] to starts[v + 1]."""
    residual: Tensor
    """(M, D)"""
    jacobian_block: Tensor
    """(M, D, B): by the parameters of the row's own block."""
    jacobian_shared: Tensor
    """(M, D, S)"""


class Problem(Protocol):
    """What is to be minimised: a sum over rows, plus quadratic priors on the parameters."""

    @property
    def precision(self) -> Tensor:
        """(S, S) P of the prior's cost x^T P x on the shared parameters x."""
        ...

    @property
    def block_precision(self) -> Tensor:
        """(B,) p of the prior's cost p . y^2 on each block's parameters y; 0 where nothing is known
        of one.
        """
        ...

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        """(S,) and (V, B) to the sum over rows, the prior left out; infinite where the model fails,
        which forbids the step.
        """
        ...

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterable[Linearised]:
        """(S,) and (V, B) to rows whose squares have the cost's gradient, and about its Hessian:
        all blocks, some at a time, so that the memory need not hold the whole Jacobian at once.
        """
        ...

    def settled(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        """(S,) and (V, B) to blocks that fit these shared parameters no worse, by a step of each
        block's own, and the cost there.
        """
        ...

    def bent(
        self,
        pieces: Iterable[Linearised],
        shared: Tensor,
        blocks: Tensor,
        move: tuple[Tensor, Tensor],
    ) -> Iterable[Tensor]:
        """(M, D) of each of these pieces, linearised at a point, the residuals' second derivative
        along a (S,) and (V, B) move.
        """
        ...


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Of the rows, without the prior, in blocks: B parameters in each of V, and S shared ones."""

    hessian_block: Tensor
    """(V, B, B), the diagonal blocks of J^T J."""
    hessian_cross: Tensor
    """(V, B, S)"""
    hessian_shared: Tensor
    """(S, S)"""
    gradient_block: Tensor
    """(V, B) of J^T r."""
    gradient_shared: Tensor
    """(S,)"""
    sum_of_squares: float
    """Of the rows' residuals."""

    @property
    def finite(self) -> bool:
        parts = (
            self.hessian_block,
            self.hessian_cross,
            self.hessian_shared,
            self.gradient_block,
            self.gradient_shared,
        )
        return math.isfinite(self.sum_of_squares) and all(
            bool(torch.isfinite(part).all()) for part in parts
        )

    def schur_complement(self) -> tuple[Tensor, Tensor]:
        """The (S, S) Hessian and (S,) gradient of the shared parameters once every block has
        adapted: the reduced camera system. NaN where the equations are not finite.
        """
        damped = self.hessian_block + 1e-12 * torch.diag_embed(_diagonal(self.hessian_block))
        solved = _solve(
            damped, torch.cat([self.hessian_cross, self.gradient_block.unsqueeze(-1)], -1)
        )
        cross = self.hessian_cross.flatten(0, 1)
        hessian = self.hessian_shared - cross.mT @ solved[..., :-1].flatten(0, 1)
        return (hessian + hessian.mT) / 2, self.gradient_shared - cross.mT @ solved[
            ..., -1
        ].flatten()


@dataclass(frozen=True, slots=True)
class Solution:
    """Where the solver ended."""

    outcome: Outcome
    shared: Tensor
    """(S,)"""
    blocks: Tensor
    """(V, B)"""
    cost: float
    """The sum over rows and the prior."""
    iterations: int
    equations: NormalEquations
    """Of the rows there, with the prior on the blocks' own parameters."""


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
        steps: linearisations at most.
        tolerance: stop when a step promises to lower the cost by less than this fraction.
        progress: called with the step's number and the cost after each accepted step.

    Raises:
        ValueError: the cost at the start is not a number: no step could be told from a better one.
    """
    precision = problem.precision

    def prior(shared: Tensor, blocks: Tensor) -> float:
        return float(shared @ precision @ shared) + float(
            (blocks**2 @ problem.block_precision).sum()
        )

    def equations_at(
        shared: Tensor, blocks: Tensor
    ) -> tuple[NormalEquations, Iterable[Linearised]]:
        pieces = _Kept(lambda: problem.linearise(shared, blocks))
        rows, own = normal_equations(pieces), problem.block_precision
        return (
            replace(
                rows,
                hessian_block=rows.hessian_block + own.diag(),
                gradient_block=rows.gradient_block + own * blocks,
            ),
            pieces,
        )

    cost = problem.cost(shared, blocks) + prior(shared, blocks)
    if math.isnan(cost):
        raise ValueError("the cost at the start is not a number")
    damping = FIRST_DAMPING
    for step in range(1, steps + 1):
        rows, pieces = equations_at(shared, blocks)
        if not (rows.finite and math.isfinite(cost)):
            return Solution(Outcome.NOT_FINITE, shared, blocks, cost, step, rows)
        whole = replace(
            rows,
            hessian_shared=rows.hessian_shared + precision,
            gradient_shared=rows.gradient_shared + precision @ shared,
        )
        growth = 2.0
        for _ in range(TRIES):
            move = _damped_step(whole, damping)
            promised = -_model_change(whole, *move)
            if promised <= tolerance * cost or cost < ROUNDING:
                # A heavily damped step promises little whatever the gradient.
                outcome = Outcome.CONVERGED if damping <= 1 or cost < ROUNDING else Outcome.STUCK
                return Solution(outcome, shared, blocks, cost, step, rows)
            moved = shared + move[0]
            moved_blocks, new_cost = problem.settled(moved, blocks + move[1])
            new_cost += prior(moved, moved_blocks)
            if not (cost - new_cost) / promised > STRAIGHT and math.isfinite(promised):
                once, again = tee(pieces)  # which may have to be made anew
                bend = _bend(whole, once, problem.bent(again, shared, blocks, move), damping)
                bent = moved + bend[0]
                bent_blocks, bent_cost = problem.settled(bent, blocks + move[1] + bend[1])
                bent_cost += prior(bent, bent_blocks)
                if bent_cost < new_cost:
                    moved, moved_blocks, new_cost = bent, bent_blocks, bent_cost
            gain = (cost - new_cost) / promised
            if gain > 0:  # false for a cost that is not finite
                break
            damping = max(damping, SMALLEST_HELP) * growth
            growth *= 2
        else:
            outcome = Outcome.STUCK if math.isfinite(promised) else Outcome.NOT_FINITE
            return Solution(outcome, shared, blocks, cost, step, rows)
        shared, blocks, cost = moved, moved_blocks, new_cost
        damping = (max(damping, SMALLEST_HELP) if gain < 0.25 else damping) * max(
            1 / 3, 1 - (2 * gain - 1) ** 3
        )
        if progress:
            progress(step, cost)
    rows, _ = equations_at(shared, blocks)
    return Solution(
        Outcome.STEPS_USED_UP if rows.finite else Outcome.NOT_FINITE,
        shared,
        blocks,
        cost,
        steps,
        rows,
    )


def normal_equations(pieces: Iterable[Linearised]) -> NormalEquations:
    """The normal equations of linearised rows, block by block."""
    block, cross, gradient, shared, gradient_shared = [], [], [], [], []
    sum_of_squares = 0.0
    for at in pieces:
        for first, last in pairwise(at.starts.tolist()):
            own = at.jacobian_block[first:last].flatten(0, 1)
            block.append(own.mT @ own)
            cross.append(own.mT @ at.jacobian_shared[first:last].flatten(0, 1))
            gradient.append(own.mT @ at.residual[first:last].flatten())
        jacobian, residual = at.jacobian_shared.flatten(0, 1), at.residual.flatten()
        shared.append(jacobian.mT @ jacobian)
        gradient_shared.append(jacobian.mT @ residual)
        sum_of_squares += float(residual @ residual)
    return NormalEquations(
        hessian_block=torch.stack(block),
        hessian_cross=torch.stack(cross),
        hessian_shared=torch.stack(shared).sum(0),
        gradient_block=torch.stack(gradient),
        gradient_shared=torch.stack(gradient_shared).sum(0),
        sum_of_squares=sum_of_squares,
    )


def _damped_step(at: NormalEquations, damping: float) -> tuple[Tensor, Tensor]:
    """The (S,) and (V, B) step: the shared parameters by the Schur complement, then the blocks by
    back-substitution. NaN where the damped equations are singular still.
    """
    block = at.hessian_block + damping * torch.diag_embed(_diagonal(at.hessian_block))
    shared = at.hessian_shared + damping * torch.diag_embed(_diagonal(at.hessian_shared))
    solved = _solve(
        block, torch.cat([at.hessian_cross, at.gradient_block.unsqueeze(-1)], -1)
    )  # (V, B, S + 1)
    from_cross, from_gradient = solved[..., :-1], solved[..., -1]
    cross = at.hessian_cross.flatten(0, 1)
    move_shared = torch.zeros_like(at.gradient_shared)
    if len(move_shared):
        schur = shared - cross.mT @ from_cross.flatten(0, 1)
        move_shared = -_solve(schur, at.gradient_shared - cross.mT @ from_gradient.flatten())
    return move_shared, -(from_gradient + from_cross @ move_shared)


def _bend(
    at: NormalEquations, pieces: Iterable[Linearised], bent: Iterable[Tensor], damping: float
) -> tuple[Tensor, Tensor]:
    """Half the geodesic acceleration: what a damped step lacks for the residuals' second derivative
    along it.
    """
    by_block, by_shared = [], torch.zeros_like(at.gradient_shared)
    for piece, bend in zip(pieces, bent, strict=True):
        by_shared = by_shared + piece.jacobian_shared.flatten(0, 1).mT @ bend.flatten()
        for first, last in pairwise(piece.starts.tolist()):
            by_block.append(
                piece.jacobian_block[first:last].flatten(0, 1).mT @ bend[first:last].flatten()
            )
    return _damped_step(
        replace(at, gradient_block=torch.stack(by_block) / 2, gradient_shared=by_shared / 2),
        damping,
    )


class _Kept:
    """Pieces that are made once if they are few, and else again for everyone who asks."""

    def __init__(self, make: Callable[[], Iterable[Linearised]]) -> None:
        self._make = make
        self._kept: list[Linearised] = []

    def __iter__(self) -> Iterator[Linearised]:
        if self._kept:
            yield from self._kept
            return
        found: list[Linearised] = []
        for count, piece in enumerate(self._make()):
            found = [*found, piece] if count < KEPT else []
            yield piece
        self._kept = found


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """The solution of (..., n, n) times it = `right`, (..., n, k) or (n,); NaN where the matrix is
    singular.
    """
    solved, singular = torch.linalg.solve_ex(matrix, right)
    failed = (singular != 0).reshape(singular.shape + (1,) * (right.ndim - singular.ndim))
    return torch.where(failed, torch.nan, solved)


def _diagonal(matrix: Tensor) -> Tensor:
    """(..., n) the diagonal, kept away from zero for parameters that move nothing."""
    diagonal = matrix.diagonal(dim1=-2, dim2=-1)
    floor = 1e-12 * diagonal.amax(-1, keepdim=True) if diagonal.shape[-1] else 0.0
    return diagonal.clamp_min(1e-30) + floor


def _model_change(at: NormalEquations, shared: Tensor, blocks: Tensor) -> float:
    """By how much the quadratic model says that the cost changes."""
    linear = 2 * (at.gradient_shared @ shared + (at.gradient_block * blocks).sum())
    quadratic = (
        torch.einsum("vb,vbc,vc->", blocks, at.hessian_block, blocks)
        + shared @ at.hessian_shared @ shared
    )
    mixed = 2 * torch.einsum("vb,vbs,s->", blocks, at.hessian_cross, shared)
    return float(linear + quadratic + mixed)
