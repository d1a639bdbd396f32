"""Levenberg-Marquardt on block-structured least squares. It knows vectors only.

Every row of residuals depends on the shared numbers and on the numbers of its own block (a view's pose, say). Blocks are eliminated
by the Schur complement, so the time grows linearly with their number.

Sources: K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004), section 3.2, for the damping;
B. Triggs et al., Bundle adjustment: a modern synthesis (2000), section 6.1, for the elimination.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor


class Outcome(Enum):
    """How a fit ended."""

    CONVERGED = "The fit has converged: no step lowers the error any more."
    STEPS_USED_UP = "The fit was still improving when its steps were used up: allow more steps."
    STUCK = "No step of any length lowers the error: the start is too far away, or the model does not fit these data."


@dataclass(frozen=True, slots=True)
class Linearised:
    """Residuals and their derivatives at one point, in units of their standard deviation, robust weights included."""

    residual: Tensor
    """(M, D)"""
    by_block: Tensor
    """(M, D, B): by the numbers of the row's own block."""
    by_shared: Tensor
    """(M, D, S)"""


class Problem(Protocol):
    """What is to be minimised: a sum over rows, plus a quadratic prior on the shared numbers."""

    @property
    def starts(self) -> Tensor:
        """(V + 1,) int64: the rows of block v are starts[v] to starts[v + 1]."""
        ...

    @property
    def precision(self) -> Tensor:
        """(S, S) P of the prior's cost x^T P x on the shared numbers x."""
        ...

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        """(S,) and (V, B) to the sum over rows, the prior left out; infinite where the model fails, which forbids the step."""
        ...

    def linearise(self, shared: Tensor, blocks: Tensor) -> Linearised:
        """(S,) and (V, B) to rows whose squares have the cost's gradient, and about its curvature."""
        ...


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


@dataclass(frozen=True, slots=True)
class Normal:
    """The normal equations of the rows, without the prior, in blocks."""

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

    def reduced(self) -> tuple[Tensor, Tensor]:
        """What the rows say of the shared numbers once every block has adapted: (S, S) curvature and (S,) slope."""
        damped = self.block + 1e-12 * torch.diag_embed(_diagonal(self.block))
        solved = torch.linalg.solve(damped, torch.cat([self.cross, self.block_slope.unsqueeze(-1)], -1))
        flat = self.cross.flatten(0, 1)
        curvature = self.shared - flat.mT @ solved[..., :-1].flatten(0, 1)
        return (curvature + curvature.mT) / 2, self.shared_slope - flat.mT @ solved[..., -1].flatten()


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
    """
    precision = problem.precision
    cost = problem.cost(shared, blocks) + float(shared @ precision @ shared)
    damping, growth = 1e-4, 2.0
    for step in range(1, steps + 1):
        rows = normal_equations(problem.starts, problem.linearise(shared, blocks))
        normal = replace(rows, shared=rows.shared + precision, shared_slope=rows.shared_slope + precision @ shared)
        while True:
            move_shared, move_blocks = _damped_step(normal, damping)
            promised = -_model_change(normal, move_shared, move_blocks)
            if promised <= tolerance * cost or cost == 0:
                return Solution(Outcome.CONVERGED, shared, blocks, cost, step)
            moved = shared + move_shared
            new_cost = problem.cost(moved, blocks + move_blocks) + float(moved @ precision @ moved)
            gain = (cost - new_cost) / promised
            if gain > 0:  # false for a cost that is not finite
                break
            damping *= growth
            growth *= 2
            if damping > 1e12:
                return Solution(Outcome.STUCK, shared, blocks, cost, step)
        shared, blocks, cost = moved, blocks + move_blocks, new_cost
        damping *= max(1 / 3, 1 - (2 * gain - 1) ** 3)
        growth = 2.0
        if progress:
            progress(step, cost)
    return Solution(Outcome.STEPS_USED_UP, shared, blocks, cost, steps)


def normal_equations(starts: Tensor, at: Linearised) -> Normal:
    """The normal equations of linearised rows, block by block."""
    rows = starts.tolist()
    block, cross, slope = [], [], []
    for first, last in pairwise(rows):
        own = at.by_block[first:last].flatten(0, 1)
        block.append(own.mT @ own)
        cross.append(own.mT @ at.by_shared[first:last].flatten(0, 1))
        slope.append(own.mT @ at.residual[first:last].flatten())
    flat = at.by_shared.flatten(0, 1)
    return Normal(torch.stack(block), torch.stack(cross), flat.mT @ flat, torch.stack(slope), flat.mT @ at.residual.flatten())


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
