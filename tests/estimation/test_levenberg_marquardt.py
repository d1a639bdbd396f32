"""The solver, on problems whose answer is known without it."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor

from calib.estimation import levenberg_marquardt
from calib.estimation import normal_equations as normal_equations_module
from calib.estimation.levenberg_marquardt import MAX_TRIES, Outcome, RowLinearised, minimise
from calib.estimation.normal_equations import LinearisedBlocks, normal_equations


class Settling(RowLinearised):
    """A problem whose blocks settle by a Gauss-Newton step each, and stay where that does not lower
    the cost of all, and whose rows bend as differences of its residuals say.
    """

    block_precision: Tensor

    def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
        raise NotImplementedError

    def second_derivative_along(
        self,
        pieces: Iterable[LinearisedBlocks],
        shared: Tensor,
        blocks: Tensor,
        move: tuple[Tensor, Tensor],
    ) -> list[Tensor]:
        near, size = 1e-3, [len(at.residual) for at in pieces]
        ahead = self.residual(shared + near * move[0], blocks + near * move[1])
        middle = self.residual(shared, blocks)
        behind = self.residual(shared - near * move[0], blocks - near * move[1])
        return list(
            torch.split(((ahead - 2 * middle + behind) / near**2).reshape(sum(size), -1), size)
        )

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        raise NotImplementedError

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
        raise NotImplementedError

    def inner_step(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        rows, precision = normal_equations(self.linearise(shared, blocks)), self.block_precision
        gradient = rows.gradient_block + precision * blocks
        moved = (
            blocks
            - (torch.linalg.pinv(rows.hessian_block + precision.diag()) @ gradient[..., None])[
                ..., 0
            ]
        )
        best = min(
            (blocks, moved),
            key=lambda candidate: (
                self.cost(shared, candidate) + float((candidate**2 @ precision).sum())
            ),
        )
        return best, self.cost(shared, best)


class Curves(Settling):
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
        self.y = self.curve(self.k, self.own) + noise * torch.from_numpy(
            rng.normal(size=12 * blocks)
        )

    def curve(self, shared: Tensor, blocks: Tensor) -> Tensor:
        a, c = blocks[self.block].unbind(-1)
        return a * torch.exp(-shared * self.x) + c

    def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
        return (self.curve(shared, blocks) - self.y).unsqueeze(-1)

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        return float((self.residual(shared, blocks) ** 2).sum())

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
        bell = torch.exp(-shared * self.x)
        jacobian_block = torch.stack([bell, torch.ones_like(bell)], -1).unsqueeze(1)
        jacobian_shared = (-self.x * blocks[self.block][:, 0] * bell).reshape(-1, 1, 1)
        half = len(self.own) // 2
        rows = slice(0, 12 * half), slice(12 * half, None)
        starts = self.starts[: half + 1], self.starts[half:] - 12 * half
        residual = self.residual(shared, blocks)
        return [
            LinearisedBlocks(
                first, residual[selected], jacobian_block[selected], jacobian_shared[selected]
            )
            for first, selected in zip(starts, rows, strict=True)
        ]


def start(problem: Curves) -> tuple[Tensor, Tensor]:
    return torch.tensor([0.3], dtype=torch.float64), torch.ones_like(problem.own)


def test_recovers_shared_and_own_parameters() -> None:
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

    dense = least_squares(
        flat, np.concatenate([[0.3], np.ones(10)]), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    ours = np.concatenate([solution.shared.numpy(), solution.blocks.numpy().ravel()])
    assert solution.cost == pytest.approx(2 * dense.cost, rel=1e-9)
    assert np.abs(ours - dense.x).max() < 1e-4  # where the cost is flat to 1e-10


def test_works_without_shared_parameters() -> None:
    problem = Curves(2, blocks=3, noise=0.0)
    held = problem.k

    class Own(Settling):
        precision = torch.zeros(0, 0, dtype=torch.float64)
        block_precision = problem.block_precision

        def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
            del shared
            return problem.residual(held, blocks)

        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            del shared
            return problem.cost(held, blocks)

        def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
            return [
                replace(at, jacobian_shared=at.jacobian_shared[..., : len(shared)])
                for at in problem.linearise(held, blocks)
            ]

    solution = minimise(Own(), torch.zeros(0, dtype=torch.float64), torch.ones_like(problem.own))
    assert solution.outcome is Outcome.CONVERGED
    assert (solution.blocks - problem.own).abs().max() < 1e-6


def test_reports_that_its_steps_are_used_up() -> None:
    problem = Curves(0, blocks=7, noise=0.0)
    assert minimise(problem, *start(problem), steps=2).outcome is Outcome.STEPS_USED_UP


def test_refuses_a_step_to_a_cost_that_is_not_finite_and_reports_stuck() -> None:
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


def test_a_prior_pulls_in_proportion_to_its_precision() -> None:
    """One shared number seen once at 1 with unit noise, prior precision 3 around 0: the answer is 1
    / (1 + 3).
    """

    class Seen(Settling):
        precision = torch.tensor([[3.0]], dtype=torch.float64)
        block_precision = torch.zeros(0, dtype=torch.float64)

        def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
            del blocks
            return (shared - 1).reshape(1, 1)

        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            return float(self.residual(shared, blocks).square().sum())

        def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
            del blocks
            unit = torch.ones(1, 1, 1, dtype=torch.float64)
            return [
                LinearisedBlocks(
                    torch.tensor([0, 1]),
                    (shared - 1).reshape(1, 1),
                    torch.zeros(1, 1, 0, dtype=torch.float64),
                    unit,
                )
            ]

    solution = minimise(
        Seen(), torch.zeros(1, dtype=torch.float64), torch.zeros(1, 0, dtype=torch.float64)
    )
    assert solution.shared.item() == pytest.approx(0.25, abs=1e-9)


def test_a_prior_on_blocks_pulls_each_of_them() -> None:
    """The oracle: the same prior as rows of their own."""
    problem = Curves(3, blocks=4, noise=0.1)
    problem.block_precision = torch.tensor([0.0, 5.0], dtype=torch.float64)

    def rows(x: np.ndarray) -> np.ndarray:
        shared, blocks = torch.from_numpy(x[:1]), torch.from_numpy(x[1:]).reshape(-1, 2)
        return np.concatenate(
            [problem.residual(shared, blocks).numpy().ravel(), 5**0.5 * blocks[:, 1].numpy()]
        )

    start_vectors = [piece.numpy().ravel() for piece in start(problem)]
    oracle = least_squares(
        rows, np.concatenate(start_vectors), xtol=1e-14, ftol=1e-14, gtol=1e-14
    ).x
    solution = minimise(problem, *start(problem), tolerance=1e-14)
    assert solution.shared.numpy() == pytest.approx(oracle[:1], abs=1e-6)
    assert solution.blocks.numpy().ravel() == pytest.approx(oracle[1:], abs=1e-6)


class Ruined(Curves):
    """Curves whose Jacobian stops being finite after some linearisations, and that count how often
    they are asked.
    """

    def __init__(self, sound: int) -> None:
        super().__init__(0, blocks=3, noise=0.0)
        self.sound = sound
        self.linearised = self.costs = 0

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        self.costs += 1
        assert self.costs < 100, "the solver hangs"
        return super().cost(shared, blocks)

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
        self.linearised += 1
        pieces = super().linearise(shared, blocks)
        if self.linearised > self.sound:
            pieces[1].jacobian_shared[4, 0, 0] = torch.nan
        return pieces


def test_a_jacobian_that_is_not_finite_ends_the_fit_at_once() -> None:
    problem = Ruined(sound=0)
    solution = minimise(problem, *start(problem))
    assert solution.outcome is Outcome.NOT_FINITE
    assert (problem.costs, problem.linearised) == (1, 1)
    assert torch.equal(solution.shared, start(problem)[0])
    assert torch.equal(solution.blocks, start(problem)[1])
    reduced = solution.equations.eliminate_blocks()
    assert reduced.hessian.isnan().all()
    assert reduced.gradient.isnan().all()


@pytest.mark.parametrize("steps", [50, 1])
def test_a_jacobian_that_is_not_finite_after_a_step_keeps_the_step(steps: int) -> None:
    """The solver sees it after one step only when its steps are used up."""
    problem = Ruined(sound=1)
    solution = minimise(problem, *start(problem), steps=steps)
    assert solution.outcome is Outcome.NOT_FINITE
    assert problem.linearised <= 3  # the second may be where the cost rose, and is left again
    assert problem.costs <= 1 + MAX_TRIES
    assert solution.cost < Curves.cost(problem, *start(problem))


def test_a_cost_that_is_infinite_everywhere_is_not_called_converged() -> None:
    class Nowhere(Curves):
        def cost(self, shared: Tensor, blocks: Tensor) -> float:
            del shared, blocks
            return float("inf")

    problem = Nowhere(0, blocks=2, noise=0.0)
    solution = minimise(problem, *start(problem))
    assert solution.outcome is Outcome.NOT_FINITE
    assert torch.equal(solution.shared, start(problem)[0])


class Valley(Settling):
    """H. H. Rosenbrock's, An automatic method for finding the greatest or least value of a function
    (1960): 100 (y - x^2)^2 + (1 - x)^2, y of the one block and x shared.
    """

    precision = torch.zeros(1, 1, dtype=torch.float64)
    block_precision = torch.zeros(1, dtype=torch.float64)

    def residual(self, shared: Tensor, blocks: Tensor) -> Tensor:
        return torch.stack([10 * (blocks[:, 0] - shared**2), 1 - shared], -1)

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        return float((self.residual(shared, blocks) ** 2).sum())

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
        by_block = torch.tensor([[[10.0], [0.0]]], dtype=torch.float64)
        by_shared = torch.stack([-20 * shared, -torch.ones_like(shared)], -1).reshape(1, 2, 1)
        return [
            LinearisedBlocks(
                torch.tensor([0, 1]), self.residual(shared, blocks), by_block, by_shared
            )
        ]


def test_a_curved_valley_is_followed() -> None:
    """The first step alone lands where the cost is a hundred times as high; the block once settled,
    at the minimum.
    """
    initial = torch.tensor([-1.2], dtype=torch.float64), torch.tensor([[1.0]], dtype=torch.float64)
    minimum = torch.tensor([1.0], dtype=torch.float64), torch.tensor([[-3.84]], dtype=torch.float64)
    assert Valley().cost(*minimum) > 90 * Valley().cost(*initial)
    solution = minimise(Valley(), *initial)
    assert solution.outcome is Outcome.CONVERGED
    assert solution.iterations <= 4  # the damping leaves a little
    assert solution.shared.item() == pytest.approx(1.0)
    assert solution.blocks.item() == pytest.approx(1.0)


@pytest.mark.parametrize("stored", [1, 2])
def test_a_bend_needs_no_jacobian_in_memory(stored: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The solver computes again the pieces that are too many to keep."""

    class Counted(Curves):
        linearised = 0

        def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
            self.linearised += 1
            return super().linearise(shared, blocks)

        def inner_step(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
            return blocks, self.cost(shared, blocks)

    monkeypatch.setattr(levenberg_marquardt, "MAX_CACHED_PIECES", stored)
    problem = Counted(0, blocks=7, noise=0.01)
    solution = minimise(problem, *start(problem), tolerance=1e-12)
    assert solution.outcome is Outcome.CONVERGED
    assert (problem.linearised > solution.iterations) == (stored == 1)
    assert problem.linearised < 2 * solution.iterations, "once more where a step is bent"
    assert solution.shared.item() == pytest.approx(1.7, abs=0.05)


class Straight(Curves):
    """Rows that are linear: their Jacobian is kept."""

    def __init__(self, jacobian_block: Tensor, jacobian_shared: Tensor) -> None:
        super().__init__(0, blocks=3, noise=0.0)
        self.jacobians = jacobian_block, jacobian_shared

    def curve(self, shared: Tensor, blocks: Tensor) -> Tensor:
        block, by_shared = (
            self.jacobians
            if hasattr(self, "jacobians")
            else (torch.ones(36, 2, dtype=torch.float64),) * 2
        )
        return (block * blocks[self.block]).sum(-1) + by_shared[:, 0] * shared

    def linearise(self, shared: Tensor, blocks: Tensor) -> list[LinearisedBlocks]:
        by_block = self.jacobians[0].unsqueeze(1)
        by_shared = self.jacobians[1].unsqueeze(1)
        return [LinearisedBlocks(self.starts, self.residual(shared, blocks), by_block, by_shared)]


def test_singular_blocks_are_fitted_where_the_rows_determine_them() -> None:
    """One block's two parameters do the same, another's do nothing: the oracle is the least-norm
    solution of the dense equations.
    """
    rng = torch.Generator().manual_seed(0)
    block = torch.rand(36, 2, generator=rng, dtype=torch.float64)
    block[:12, 1] = block[:12, 0]
    block[12:24] = 0
    shared = torch.rand(36, 1, generator=rng, dtype=torch.float64)
    problem = Straight(block, shared)
    solution = minimise(problem, *start(problem))
    dense = torch.cat(
        [shared, *(torch.where((problem.block == v)[:, None], block, 0.0) for v in range(3))], 1
    )
    solution_vector = np.linalg.lstsq(dense.numpy(), problem.y.numpy(), rcond=None)[0]
    residual = dense.numpy() @ solution_vector - problem.y.numpy()
    assert solution.outcome is Outcome.CONVERGED
    assert solution.cost == pytest.approx(float(residual @ residual), rel=1e-9)
    assert torch.equal(solution.blocks[1], torch.ones(2, dtype=torch.float64)), (
        "nothing moves what nothing sees"
    )
    reduced = solution.equations.eliminate_blocks()
    assert reduced.hessian.isfinite().all()
    assert reduced.gradient.isfinite().all()


def test_equations_that_overflow_end_in_an_outcome() -> None:
    """Finite rows whose squares are not."""
    problem = Straight(
        torch.full((36, 2), 1e200, dtype=torch.float64), torch.ones(36, 1, dtype=torch.float64)
    )
    assert (
        minimise(
            problem, torch.zeros(1, dtype=torch.float64), torch.zeros(3, 2, dtype=torch.float64)
        ).outcome
        is Outcome.NOT_FINITE
    )


def test_equations_that_stay_singular_end_in_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    """No damping helps where the damped matrix is singular to rounding: the tries end, and no
    LinAlgError is raised.
    """
    monkeypatch.setattr(
        normal_equations_module,
        "_positive_diagonal",
        lambda matrix: torch.zeros_like(matrix.diagonal(dim1=-2, dim2=-1)),
    )
    problem = Straight(
        torch.ones(36, 2, dtype=torch.float64), torch.ones(36, 1, dtype=torch.float64)
    )
    solution = minimise(problem, *start(problem))
    assert solution.outcome is Outcome.NOT_FINITE
    assert solution.iterations == 1
