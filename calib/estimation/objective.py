"""The cost that the solver minimises: the residuals of all views' corners, as a function of the
shared parameters of a ray path and of each view's parameters.

Huber's loss is minimised by iteratively reweighted least squares. Source: P. J. Huber, Robust
estimation of a location parameter (1964).
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import RowLinearised
from calib.estimation.normal_equations import LinearisedBlocks
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import ResidualBlock
from calib.optics.board_polynomials import bend_sigma
from calib.optics.flex_bend import FLEX_TERMS
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.view_blocks import CENTRE, FLEX, FOCAL, MOTION, POSE, blocks_of_size
from calib.session import tolerances

HUBER = 3.0
PROBE = 0.1
"""The fraction of a step at which the second derivative along it is taken, by differences."""


def view_precision(path: Path, blocks: Tensor) -> Tensor:
    """Return the (B,) prior inverse variances of the (V, B) view parameters; a pose has no
    prior.
    """
    scales = dict(path.block_scales)
    sigmas = {
        POSE: [math.inf] * 6,
        MOTION: [tolerances.BOARD_SPIN.sigma] * 3 + [tolerances.BOARD_MOVE.sigma] * 3,
        FLEX: [bend_sigma(tolerances.BOARD_FLEX.sigma, term) for term in FLEX_TERMS],
        FOCAL: [tolerances.FOCAL.sigma],
        CENTRE: [tolerances.PRINCIPAL_POINT.sigma] * 2,
    }
    return blocks.new_tensor(
        [
            (scales.get(block, 1.0) * sigma) ** -2
            for block in blocks_of_size(blocks.shape[1])
            for sigma in sigmas[block]
        ]
    )


def huber_limit(observations: Observations) -> float:
    """Return the limit of Huber's loss. An average of many corners weighs more, and what all its
    members have in common may be as large as for one corner: outliers are left out of it before.
    """
    count = 2 * len(observations.pixels)
    return HUBER * math.sqrt(observations.residual_count / count) if count else HUBER


@dataclass(frozen=True, slots=True)
class LandingProblem(RowLinearised):
    """The solver's problem for boards seen through a ray path; its blocks are the view
    parameters.
    """

    parameters: Parameters
    views: tuple[ResidualBlock, ...]
    precision: Tensor
    """(S, S) precision of the prior on the shared parameters."""
    block_precision: Tensor
    """(B,) precision of the prior on each view's parameters."""
    huber: float = HUBER
    """Standard deviations: beyond this, a corner's loss is linear in its distance, not
    quadratic.
    """

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        values = self.valid_values(shared)
        if values is None:
            return math.inf
        return sum(float(losses.sum()) for losses in self._losses(values, blocks))

    def residual(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, Tensor]:
        """Return the (M, 2) residuals of all corners, and (M,) true where the ray lands."""
        values = self.parameters.values(shared)
        results = [
            block.residual(block.rays(values, poses), values, poses)
            for block, poses in self.split(blocks)
        ]
        residual = torch.cat([residual for residual, _ in results])
        return residual, torch.cat([lands for _, lands in results])

    def losses(self, residual: Tensor, lands: Tensor) -> Tensor:
        """Return the (m,) losses whose sum is `cost`, from the results of `residual`; infinity
        where the ray does not land.
        """
        squared = (residual**2).sum(-1)
        robust = torch.where(
            squared <= self.huber**2, squared, 2 * self.huber * squared.sqrt() - self.huber**2
        )
        return torch.where(lands, robust, torch.inf)

    def block_prior(self, blocks: Tensor) -> Tensor:
        """Return the (V,) prior cost of the (V, B) view parameters."""
        return blocks**2 @ self.block_precision

    def inner_step(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        """Take a Gauss-Newton step of each view by itself where it lowers the view's cost. Rays do
        not depend on the boards' poses, so they are traced once, unless views have cameras of their
        own.
        """
        values = self.valid_values(shared)
        if values is None:
            return blocks, math.inf
        updated, total = [], 0.0
        for block, poses in self.split(blocks):
            rays = block.rays(values, poses)
            residual, jacobian, lands = block.residual_with_jacobian(rays, values, poses)
            new_poses = poses - self._block_step(block, residual, jacobian, poses)
            old_cost = self.view_costs(block, residual, lands, poses)
            if block.path.camera_block:
                rays = block.rays(values, new_poses)
            new_cost = self.view_costs(block, *block.residual(rays, values, new_poses), new_poses)
            best = torch.where((new_cost < old_cost)[:, None], new_poses, poses)
            updated.append(best)
            total += float(
                torch.where(new_cost < old_cost, new_cost, old_cost).sum()
                - self.block_prior(best).sum()
            )
        return torch.cat(updated), total

    def valid_values(self, shared: Tensor) -> dict[str, Tensor] | None:
        """Return the path's values; None if one is below its physical minimum."""
        values = self.parameters.values(shared)
        invalid = any(
            bool((values[param.name] < param.minimum).any()) for param in self.parameters.free
        )
        return None if invalid else values

    def _block_step(
        self, block: ResidualBlock, residual: Tensor, jacobian: Tensor, poses: Tensor
    ) -> Tensor:
        """Return the (V, B) Gauss-Newton step of each view, which the caller subtracts; 0 where it
        cannot be computed.
        """
        hessian, gradient = self.view_equations(block, residual, jacobian)
        hessian = hessian + self.block_precision.diag()
        gradient = gradient + self.block_precision * poses
        step, singular = torch.linalg.solve_ex(hessian, gradient)
        return torch.where((singular == 0)[:, None] & step.isfinite(), step, 0.0)

    def view_equations(
        self, block: ResidualBlock, residual: Tensor, jacobian: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the (V, B, B) Hessian and the (V, B) gradient of each view's parameters, without
        their prior, from the residuals of a block and their Jacobian by these parameters.
        """
        view, count, size = (
            block.observations.view,
            len(block.observations.names),
            jacobian.shape[2],
        )
        weighted = jacobian * (self.huber / residual.norm(dim=-1)).clamp_max(1.0)[:, None, None]
        hessian = residual.new_zeros(count, size, size).index_add(0, view, weighted.mT @ jacobian)
        gradient = residual.new_zeros(count, size).index_add(
            0, view, (weighted.mT @ residual[..., None]).squeeze(-1)
        )
        return hessian, gradient

    def view_costs(
        self, block: ResidualBlock, residual: Tensor, lands: Tensor, poses: Tensor
    ) -> Tensor:
        """Return the (V,) cost of each view's corners and prior; infinity if one of its rays does
        not land.
        """
        losses = self.losses(residual, lands)
        corners = poses.new_zeros(len(poses)).index_add(0, block.observations.view, losses)
        return corners + self.block_prior(poses)

    def _losses(self, values: Values, blocks: Tensor) -> Iterator[Tensor]:
        """Yield the (m,) losses of the corners, residual block by residual block."""
        for block, poses in self.split(blocks):
            yield self.losses(*block.residual(block.rays(values, poses), values, poses))

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterator[LinearisedBlocks]:
        values = self.parameters.values(shared)
        for block, poses in self.split(blocks):
            yield block.linearise(values, poses, self.huber)

    def second_derivative_along(
        self,
        pieces: Iterable[LinearisedBlocks],
        shared: Tensor,
        blocks: Tensor,
        move: tuple[Tensor, Tensor],
    ) -> Iterator[Tensor]:
        values = self.parameters.values(shared + PROBE * move[0])
        for piece, (block, poses), (_, moves) in zip(
            pieces, self.split(blocks + PROBE * move[1]), self.split(move[1]), strict=True
        ):
            slope = piece.jacobian_shared @ move[0] + (
                piece.jacobian_block @ moves[block.observations.view].unsqueeze(-1)
            ).squeeze(-1)
            probe, lands = block.residual(block.rays(values, poses), values, poses)
            # The square root of Huber's weight once more, from the weighted residuals.
            weight = (self.huber / piece.residual.norm(dim=-1, keepdim=True)).clamp_max(1.0)
            bend = 2 / PROBE * ((weight * probe - piece.residual) / PROBE - slope)
            yield torch.where(lands[:, None] & bend.isfinite(), bend, 0.0)

    def split(self, blocks: Tensor) -> Iterator[tuple[ResidualBlock, Tensor]]:
        """Yield each residual block with the (v, B) parameters of its views."""
        start = 0
        for block in self.views:
            count = len(block.observations.names)
            yield block, blocks[start : start + count]
            start += count
