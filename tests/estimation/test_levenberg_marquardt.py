"""The solver, on problems whose answer is known without it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearised, Outcome, minimise, normal_equations


class Curves:
    """Blocks of points on y = a exp(-k x) + c: every block has its own a and c, and all share k."""

    def __init__(self, seed: int, blocks: int, noise: float) -> None:
        rng = np.random.default_rng(seed)
        self.k = torch.tensor([1.7], dtype=torch.float64)
        self.own = torch.from_numpy(rng.uniform(0.5, 2.0, (blocks, 2)))
        self.starts = torch.arange(0, 12 * blocks + 1, 12)
        self.block = torch.arange(blocks).repeat_interleave(12)
        self.x = torch.from_numpy(rng.uniform(0, 2, 12 * blocks))
        self.precision = torch.zeros(1, 1, dtype=torch.float64)
        self.block_precision = torch.zeros(2, dtype=torch.float64)
        self.y = self.curve(self.k, self.own) + noise * torch.from_numpy(rng.normal(size=12 * blocks))

    def curve(self, shared: Tensor, blocks: Tensor) -> Tensor:
        a, c = blocks[self.block].unbind(-1)
        return a * torch.exp(-shared * self.x) + c

    def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
        return (self.curve(shared, blocks) - self.y).unsqueeze(-1)

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        return float((self.residual(shared, blocks) ** 2).sum())

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[Linearised]:
        bell = torch.exp(-shared * self.x)
        jacobian_block = torch.stack([bell, torch.ones_like(bell)], -1).unsqueeze(1)
        jacobian_shared = (-self.x * blocks[self.block][:, 0] * bell).reshape(-1, 1, 1)
        half = len(self.own) // 2
        rows = slice(0, 12 * half), slice(12 * half, None)
        starts = self.starts[: half + 1], self.starts[half:] - 12 * half
        residual = self.residual(shared, blocks)
        return [
            Linearised(first, residual[some], jacobian_block[some], jacobian_shared[some]) for first, some in zip(starts, rows, strict=True)
        ]


def start(problem: Curves) -> tuple[Tensor, Tensor]:
    return torch.tensor([0.3], dtype=torch.float64), torch.ones_like(problem.own)


def test_recovers_shared_and_own_numbers() -> None:
    problem = Curves(0, blocks=7, noise=0.0)
    solution = minimise(problem, *start(problem))
    assert solution.outcome is Outcome.CONVERGED
    assert solution.iterations < 20
    assert (solution.shared - problem.k).abs().max() < 1e-6
    assert (solution.blocks - problem.own).abs().max() < 1e-6


def test_agrees_with_a_dense_solver_that_knows_no_blocks() -> None:
    from scipy.optimize import least_squares

    problem = Curves(1, blocks=5, noise=0.05)
    solution = minimise(problem, *start(problem))

    def flat(z: np.ndarray) -> np.ndarray:
        parameters = torch.from_numpy(z)
        return problem.residual(parameters[:1], parameters[1:].reshape(-1, 2)).ravel().numpy()

    dense = least_squares(flat, np.concatenate([[0.3], np.ones(10)]), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    ours = np.concatenate([solution.shared.numpy(), solution.blocks.numpy().ravel()])
    assert solution.cost == pytest.approx(2 * dense.cost, rel=1e-9)
    assert np.abs(ours - dense.x).max() < 1e-4  # where the cost is flat to 1e-10


def test_works_without_shared_numbers() -> None:
    problem = Curves(2, blocks=3, noise=0.0)
    held = problem.k

    class Own:
        precision = torch.zeros(0, 0, dtype=torch.float64)
        block_precision = problem.block_precision

        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            del shared
            return problem.cost(held, blocks)

        def linearise(self, shared: Tensor, blocks: Tensor) -> list[Linearised]:
            return [replace(at, jacobian_shared=at.jacobian_shared[..., : len(shared)]) for at in problem.linearise(held, blocks)]

    solution = minimise(Own(), torch.zeros(0, dtype=torch.float64), torch.ones_like(problem.own))
    assert solution.outcome is Outcome.CONVERGED
    assert (solution.blocks - problem.own).abs().max() < 1e-6


def test_says_that_its_steps_are_used_up() -> None:
    problem = Curves(0, blocks=7, noise=0.0)
    assert minimise(problem, *start(problem), steps=2).outcome is Outcome.STEPS_USED_UP


def test_refuses_a_step_into_what_is_not_finite_and_says_that_it_is_stuck() -> None:
    class Cliff(Curves):
        steps = 0

        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            self.steps += 1
            return Curves.cost(self, shared, blocks) if self.steps == 1 else float("inf")

    problem = Cliff(0, blocks=2, noise=0.0)
    solution = minimise(problem, *start(problem))
    assert solution.outcome is Outcome.STUCK
    assert torch.equal(solution.shared, start(problem)[0])


def test_a_start_whose_cost_is_not_a_number_is_refused() -> None:
    problem = Curves(0, blocks=2, noise=0.0)
    problem.y[3] = torch.nan
    with pytest.raises(ValueError, match="not a number"):
        minimise(problem, *start(problem))


def test_a_prior_pulls_as_its_precision_says() -> None:
    """One shared number seen once at 1 with unit noise, prior precision 3 around 0: the answer is 1 / (1 + 3)."""

    class Seen:
        precision = torch.tensor([[3.0]], dtype=torch.float64)
        block_precision = torch.zeros(0, dtype=torch.float64)

        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            del blocks
            return float((shared - 1).square().sum())

        def linearise(self, shared: Tensor, blocks: Tensor) -> list[Linearised]:
            del blocks
            one = torch.ones(1, 1, 1, dtype=torch.float64)
            return [Linearised(torch.tensor([0, 1]), (shared - 1).reshape(1, 1), torch.zeros(1, 1, 0, dtype=torch.float64), one)]

    solution = minimise(Seen(), torch.zeros(1, dtype=torch.float64), torch.zeros(1, 0, dtype=torch.float64))
    assert solution.shared.item() == pytest.approx(0.25, abs=1e-9)


def test_a_prior_on_blocks_pulls_each_of_them() -> None:
    """The oracle: the same prior as rows of their own."""
    problem = Curves(3, blocks=4, noise=0.1)
    problem.block_precision = torch.tensor([0.0, 5.0], dtype=torch.float64)

    def rows(x: np.ndarray) -> np.ndarray:
        shared, own = torch.from_numpy(x[:1]), torch.from_numpy(x[1:]).reshape(-1, 2)
        return np.concatenate([problem.residual(shared, own).numpy().ravel(), 5**0.5 * own[:, 1].numpy()])

    begin = [part.numpy().ravel() for part in start(problem)]
    oracle = least_squares(rows, np.concatenate(begin), xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    solution = minimise(problem, *start(problem), tolerance=1e-14)
    assert solution.shared.numpy() == pytest.approx(oracle[:1], abs=1e-6)
    assert solution.blocks.numpy().ravel() == pytest.approx(oracle[1:], abs=1e-6)


def test_the_schur_complement_is_the_dense_one() -> None:
    problem = Curves(3, blocks=4, noise=0.1)
    pieces = problem.linearise(*start(problem))
    hessian, gradient = normal_equations(pieces).schur_complement()
    jacobian_block, residual = (torch.cat([getattr(at, name) for at in pieces]) for name in ("jacobian_block", "residual"))
    dense = torch.zeros(48, 9, dtype=torch.float64)
    dense[:, 0] = torch.cat([at.jacobian_shared for at in pieces])[:, 0, 0]
    for block in range(4):
        dense[12 * block : 12 * block + 12, 1 + 2 * block : 3 + 2 * block] = jacobian_block[12 * block : 12 * block + 12, 0]
    own = dense[:, 1:]
    keep = torch.eye(48, dtype=torch.float64) - own @ torch.linalg.pinv(own)
    assert hessian.item() == pytest.approx(float(dense[:, 0] @ keep @ dense[:, 0]), rel=1e-6)
    assert gradient.item() == pytest.approx(float(dense[:, 0] @ keep @ residual[:, 0]), rel=1e-6)
