"""The elimination of blocks, compared with the dense normal equations of the same random rows."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.normal_equations import (
    LinearisedBlocks,
    NormalEquations,
    ReducedProducts,
    normal_equations,
)
from calib.estimation.view_equations import ViewEquations

Array = NDArray[np.float64]

BLOCKS, BLOCK_SIZE, SHARED, ROWS = 4, 3, 5, 20
PRECISION = np.array([0.0, 2.0, 0.5])
"""The prior precision of a block's parameters."""


@pytest.fixture
def rows() -> Tensor:
    """(BLOCKS, ROWS, BLOCK_SIZE + SHARED + 1) Jacobians by block and shared parameters, and the
    residual.
    """
    rng = np.random.default_rng(7)
    return torch.from_numpy(rng.normal(size=(BLOCKS, ROWS, BLOCK_SIZE + SHARED + 1)))


def equations_of(rows: Tensor, precision: Array) -> NormalEquations:
    """Return the normal equations of the rows, with the prior of the blocks around zero."""
    piece = LinearisedBlocks(
        starts=torch.arange(0, BLOCKS * ROWS + 1, ROWS),
        residual=rows[..., -1].reshape(-1, 1),
        jacobian_block=rows[..., :BLOCK_SIZE].reshape(-1, 1, BLOCK_SIZE),
        jacobian_shared=rows[..., BLOCK_SIZE:-1].reshape(-1, 1, SHARED),
    )
    equations = normal_equations([piece])
    equations.hessian_block.add_(torch.from_numpy(precision).diag())
    return equations


def dense_system(rows: Tensor, precision: Array) -> tuple[Array, Array]:
    """Return the Hessian and the gradient by the shared parameters, then those of all blocks."""
    count = BLOCKS * BLOCK_SIZE
    jacobian = np.zeros((BLOCKS, ROWS, SHARED + count))
    jacobian[..., :SHARED] = rows[..., BLOCK_SIZE:-1]
    for block in range(BLOCKS):
        start = SHARED + block * BLOCK_SIZE
        jacobian[block, :, start : start + BLOCK_SIZE] = rows[block, :, :BLOCK_SIZE]
    stacked = jacobian.reshape(-1, SHARED + count)
    prior = np.diag(np.concatenate([np.zeros(SHARED), np.tile(precision, BLOCKS)]))
    return stacked.T @ stacked + prior, stacked.T @ rows[..., -1].numpy().ravel()


def test_the_reduced_equations_agree_with_a_dense_solution(rows: Tensor) -> None:
    hessian, gradient = dense_system(rows, PRECISION)
    covariance = np.linalg.inv(hessian)
    step = -covariance @ gradient
    reduced = equations_of(rows, PRECISION).eliminate_blocks()
    shared = -torch.linalg.solve(reduced.hessian, reduced.gradient)
    assert np.linalg.inv(reduced.hessian.numpy()) == pytest.approx(
        covariance[:SHARED, :SHARED], rel=1e-9
    )
    assert shared.numpy() == pytest.approx(step[:SHARED], rel=1e-9)
    assert reduced.block_step(shared).numpy().ravel() == pytest.approx(step[SHARED:], rel=1e-9)


def test_damping_enlarges_the_diagonal_of_the_blocks(rows: Tensor) -> None:
    hessian, gradient = dense_system(rows, PRECISION)
    entries = np.arange(SHARED, len(hessian))
    hessian[entries, entries] *= 1.3
    step = -np.linalg.solve(hessian, gradient)
    reduced = equations_of(rows, PRECISION).eliminate_blocks(0.3)
    shared = -torch.linalg.solve(reduced.hessian, reduced.gradient)
    assert shared.numpy() == pytest.approx(step[:SHARED], rel=1e-9)


def test_the_reduced_products_of_all_blocks_add_up_to_the_reduced_equations(rows: Tensor) -> None:
    """The residual is one more column of the products. Their determinant is that of the dense
    Hessian over that of its Schur complement.
    """
    products = ReducedProducts.of(rows.mT @ rows, torch.from_numpy(PRECISION))
    reduced = equations_of(rows, PRECISION).eliminate_blocks()
    total = products.products.sum(0)
    assert total[:-1, :-1].numpy() == pytest.approx(reduced.hessian.numpy(), rel=1e-9)
    assert total[:-1, -1].numpy() == pytest.approx(reduced.gradient.numpy(), rel=1e-9)
    assert products.response.numpy() == pytest.approx(reduced.response.numpy(), rel=1e-9)
    determinant = np.linalg.slogdet(dense_system(rows, PRECISION)[0])[1]
    assert float(products.log_determinant + reduced.hessian.logdet()) == pytest.approx(
        determinant, rel=1e-9
    )


def test_without_a_prior_the_projection_of_the_rows_gives_the_same_equations(rows: Tensor) -> None:
    reduced = equations_of(rows, np.zeros(BLOCK_SIZE)).eliminate_blocks()
    views = [
        ViewEquations(
            residual=view[:, -1],
            jacobian_block=view[:, :BLOCK_SIZE],
            jacobian_shared=view[:, BLOCK_SIZE:-1],
        ).reduce()
        for view in rows.numpy()
    ]
    information = sum(view.information for view in views)
    gradient = sum(view.jacobian.T @ view.residual for view in views)
    assert information == pytest.approx(reduced.hessian.numpy(), rel=1e-9)
    assert gradient == pytest.approx(reduced.gradient.numpy(), rel=1e-9)
    assert [view.freedom for view in views] == [ROWS - BLOCK_SIZE] * BLOCKS


def test_a_block_parameter_that_moves_nothing_does_not_respond(rows: Tensor) -> None:
    rows[..., 0] = 0
    reduced = equations_of(rows, np.zeros(BLOCK_SIZE)).eliminate_blocks()
    assert bool((reduced.response[:, 0] == 0).all())
    assert bool(reduced.hessian.isfinite().all())
