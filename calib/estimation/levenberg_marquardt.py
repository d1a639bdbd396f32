"""Levenberg-Marquardt on block-structured least squares. It knows vectors only.

Every row of residuals depends on the shared numbers and on the numbers of its own block (a view's pose, say). Blocks are eliminated
by the Schur complement, so the time grows linearly with their number.

Sources: K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004), section 3.2, for the damping;
B. Triggs et al., Bundle adjustment: a modern synthesis (2000), section 6.1, for the elimination.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor

FIRST_DAMPING = 1e-9
"""Of the diagonal: next to none, for the fits here are nearly linear."""
SMALLEST_HELP = 1e-5
"""Where a step fails or gains little, the damping is at least this."""

ROUNDING = 1e-26
"""A cost that exact data leave."""


class Outcome(Enum):
    """How a fit ended."""

    CONVERGED = "The fit has converged: no step lowers the error any more."
    STEPS_USED_UP = "The fit was still improving when its steps were used up: allow more steps."
    STUCK = "No step of any length lowers the error: the start is too far away, or the model does not fit these data."


@dataclass(frozen=True, slots=True)
class Linearised:
    """The residuals of some consecutive blocks and their derivatives at one point, in units of their standard deviation, robust
    weights included."""

    starts: Tensor
    """(v + 1,) int64: the rows of the v-th of these blocks are starts[v] to starts[v + 1]."""
    residual: Tensor
    """(M, D)"""
    by_block: Tensor
    """(M, D, B): by the numbers of the row's own block."""
    by_shared: Tensor
    """(M, D, S)"""


class Problem(Protocol):
    """What is to be minimised: a sum over rows, plus a quadratic prior on the shared numbers."""

    @property
    def precision(self) -> Tensor:
        """(S, S) P of the prior's cost x^T P x on the shared numbers x."""
        ...

    @property
    def block_precision(self) -> Tensor:
        """(B,) p of the prior's cost p . y^2 on each block's numbers y; 0 where nothing is known of one."""
        ...

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        """(S,) and (V, B) to the sum over rows, the prior left out; infinite where the model fails, which forbids the step."""
        ...

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterable[Linearised]:
        """(S,) and (V, B) to rows whose squares have the cost's gradient, and about its curvature: all blocks, some at a time, so that
        the memory need not hold every row's derivatives at once."""
        ...


@dataclass(frozen=True, slots=True)
class Normal:
    """The normal equations of the rows, without the prior, in blocks; B numbers in each of V, and S shared ones."""

    block: Tensor
    """(V, B, B)"""
    cross: Tensor
    """(V, B, S)"""
    shared: Tensor
    """(S, S)"""
    block_slope: Tensor
    """(V, B)"""
    shared_slope: Tensor
    """(S,)"""
    square: float
    """The rows' sum of squares."""

    def reduced(self) -> tuple[Tensor, Tensor]:
        """What the rows say of the shared numbers once every block has adapted: (S, S) curvature and (S,) slope."""
        damped = self.block + 1e-12 * torch.diag_embed(_diagonal(self.block))
        solved = torch.linalg.solve(damped, torch.cat([self.cross, self.block_slope.unsqueeze(-1)], -1))
        flat = self.cross.flatten(0, 1)
        curvature = self.shared - flat.mT @ solved[..., :-1].flatten(0, 1)
        return (curvature + curvature.mT) / 2, self.shared_slope - flat.mT @ solved[..., -1].flatten()


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
    normal: Normal
    """Of the rows there, with the prior on the blocks' own numbers."""


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
        return float(shared @ precision @ shared) + float((blocks**2 @ problem.block_precision).sum())

    def normal_at(shared: Tensor, blocks: Tensor) -> Normal:
        rows = normal_equations(problem.linearise(shared, blocks))
        own = problem.block_precision
        return replace(rows, block=rows.block + own.diag(), block_slope=rows.block_slope + own * blocks)

    cost = problem.cost(shared, blocks) + prior(shared, blocks)
    if math.isnan(cost):
        raise ValueError("the cost at the start is not a number")
    damping, growth = FIRST_DAMPING, 2.0
    for step in range(1, steps + 1):
        rows = normal_at(shared, blocks)
        normal = replace(rows, shared=rows.shared + precision, shared_slope=rows.shared_slope + precision @ shared)
        while True:
            move_shared, move_blocks = _damped_step(normal, damping)
            promised = -_model_change(normal, move_shared, move_blocks)
            if promised <= tolerance * cost or cost < ROUNDING:
                # A heavily damped step promises little whatever the slope.
                outcome = Outcome.CONVERGED if damping <= 1 or cost < ROUNDING else Outcome.STUCK
                return Solution(outcome, shared, blocks, cost, step, rows)
            moved = shared + move_shared
            new_cost = problem.cost(moved, blocks + move_blocks) + prior(moved, blocks + move_blocks)
            gain = (cost - new_cost) / promised
            if gain > 0:  # false for a cost that is not finite
                break
            damping = max(damping, SMALLEST_HELP) * growth
            growth *= 2
        shared, blocks, cost = moved, blocks + move_blocks, new_cost
        damping = (max(damping, SMALLEST_HELP) if gain < 0.25 else damping) * max(1 / 3, 1 - (2 * gain - 1) ** 3)
        growth = 2.0
        if progress:
            progress(step, cost)
    rows = normal_at(shared, blocks)
    return Solution(Outcome.STEPS_USED_UP, shared, blocks, cost, steps, rows)


def normal_equations(pieces: Iterable[Linearised]) -> Normal:
    """The normal equations of linearised rows, block by block."""
    block, cross, slope, shared, shared_slope = [], [], [], [], []
    square = 0.0
    for at in pieces:
        for first, last in pairwise(at.starts.tolist()):
            own = at.by_block[first:last].flatten(0, 1)
            block.append(own.mT @ own)
            cross.append(own.mT @ at.by_shared[first:last].flatten(0, 1))
            slope.append(own.mT @ at.residual[first:last].flatten())
        flat, residual = at.by_shared.flatten(0, 1), at.residual.flatten()
        shared.append(flat.mT @ flat)
        shared_slope.append(flat.mT @ residual)
        square += float(residual @ residual)
    whole, whole_slope = (torch.stack(part).sum(0) for part in (shared, shared_slope))
    return Normal(torch.stack(block), torch.stack(cross), whole, torch.stack(slope), whole_slope, square)


def _damped_step(normal: Normal, damping: float) -> tuple[Tensor, Tensor]:
    """The (S,) and (V, B) step of the equations damped by a fraction of their own diagonal."""
    block = normal.block + damping * torch.diag_embed(_diagonal(normal.block))
    shared = normal.shared + damping * torch.diag_embed(_diagonal(normal.shared))
    solved = torch.linalg.solve(block, torch.cat([normal.cross, normal.block_slope.unsqueeze(-1)], -1))  # (V, B, S + 1)
    away, pull = solved[..., :-1], solved[..., -1]
    flat_cross = normal.cross.flatten(0, 1)
    move_shared = torch.zeros_like(normal.shared_slope)
    if len(move_shared):
        reduced = shared - flat_cross.mT @ away.flatten(0, 1)
        move_shared = -torch.linalg.solve(reduced, normal.shared_slope - flat_cross.mT @ pull.flatten())
    return move_shared, -(pull + away @ move_shared)


def _diagonal(matrix: Tensor) -> Tensor:
    """(..., n) the diagonal, kept away from zero for numbers that move nothing."""
    diagonal = matrix.diagonal(dim1=-2, dim2=-1)
    floor = 1e-12 * diagonal.amax(-1, keepdim=True) if diagonal.shape[-1] else 0.0
    return diagonal.clamp_min(1e-30) + floor


def _model_change(normal: Normal, shared: Tensor, blocks: Tensor) -> float:
    """By how much the quadratic model says that the cost changes."""
    linear = 2 * (normal.shared_slope @ shared + (normal.block_slope * blocks).sum())
    bent = torch.einsum("vb,vbc,vc->", blocks, normal.block, blocks) + shared @ normal.shared @ shared
    mixed = 2 * torch.einsum("vb,vbs,s->", blocks, normal.cross, shared)
    return float(linear + bent + mixed)
