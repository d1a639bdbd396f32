"""What the solver minimises: the residuals of all views' corners, by the shared parameters of a ray
path and by each view's own.

Huber's loss is minimised by iteratively reweighted least squares. Source: P. J. Huber, Robust
estimation of a location parameter (1964).
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearised
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import Landing
from calib.optics.board_target import FLEX, MOTION, POSE, blocks_of_size
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.tolerances import BOARD_FLEX, BOARD_MOVE, BOARD_SPIN

HUBER = 3.0
PROBE = 0.1
"""Of a step: how far along it the second derivative is taken, by differences."""


def view_precision(path: Path, blocks: Tensor) -> Tensor:
    """(B,) inverse variances of each view's own parameters (V, B) beforehand: nothing is known of
    its pose.
    """
    sizes = dict(path.block_scales)
    spreads = {
        POSE: [math.inf] * 6,
        MOTION: [BOARD_SPIN.sigma] * 3 + [BOARD_MOVE.sigma] * 3,
        FLEX: [BOARD_FLEX.sigma] * 3,
    }
    return blocks.new_tensor(
        [
            (sizes.get(part, 1.0) * sigma) ** -2
            for part in blocks_of_size(blocks.shape[1])
            for sigma in spreads[part]
        ]
    )


@dataclass(frozen=True, slots=True)
class LandingProblem:
    """The solver's view of boards seen through a ray path; its blocks are the views' own
    parameters.
    """

    parameters: Parameters
    views: tuple[Landing, ...]
    precision: Tensor
    """(S, S) of the prior on the shared parameters."""
    block_precision: Tensor
    """(B,) of the prior on each view's own parameters."""
    huber: float = HUBER
    """Standard deviations beyond which a corner counts by its distance, not by its square."""

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        values = self._possible(shared)
        return (
            math.inf
            if values is None
            else sum(float(each.sum()) for each in self._losses(values, blocks))
        )

    def missed(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, Tensor]:
        """(M, 2) residuals of all corners, and (M,) bool whether each ray lands."""
        values = self.parameters.values(shared)
        each = [
            landing.residual(landing.rays(values), values, poses)
            for landing, poses in self._split(blocks)
        ]
        return torch.cat([residual for residual, _ in each]), torch.cat(
            [lands for _, lands in each]
        )

    def losses(self, residual: Tensor, lands: Tensor) -> Tensor:
        """(m,) of which `cost` is the sum, from what `missed` has; infinite where a ray does not
        land.
        """
        squared = (residual**2).sum(-1)
        robust = torch.where(
            squared <= self.huber**2, squared, 2 * self.huber * squared.sqrt() - self.huber**2
        )
        return torch.where(lands, robust, torch.inf)

    def prior_of_blocks(self, blocks: Tensor) -> Tensor:
        """(V,) of the prior on the views' own (V, B) parameters."""
        return blocks**2 @ self.block_precision

    def settled(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        """A Gauss-Newton step of each view by itself, taken where it lowers its own cost: rays do
        not depend on where boards are, so they are traced once.
        """
        values, found, total = self._possible(shared), [], 0.0
        if values is None:
            return blocks, math.inf
        for landing, own in self._split(blocks):
            rays = landing.rays(values)
            residual, jacobian, lands = landing.by_own(rays, values, own)
            moved = own - self._own_step(landing, residual, jacobian, own)
            before = self._own_cost(landing, residual, lands, own)
            after = self._own_cost(landing, *landing.residual(rays, values, moved), moved)
            best = torch.where((after < before)[:, None], moved, own)
            found.append(best)
            total += float(
                torch.where(after < before, after, before).sum() - self.prior_of_blocks(best).sum()
            )
        return torch.cat(found), total

    def _possible(self, shared: Tensor) -> dict[str, Tensor] | None:
        """The path's values, unless one is beyond what it can be."""
        values = self.parameters.values(shared)
        return (
            None
            if any(
                bool((values[param.name] < param.minimum).any()) for param in self.parameters.free
            )
            else values
        )

    def _own_step(
        self, landing: Landing, residual: Tensor, jacobian: Tensor, own: Tensor
    ) -> Tensor:
        """(V, B) by how much each view's own parameters are beyond their optimum; 0 where that is
        not known.
        """
        view, (count, size) = landing.observations.view, own.shape
        weighted = jacobian * (self.huber / residual.norm(dim=-1)).clamp_max(1.0)[:, None, None]
        hessian = (
            own.new_zeros(count, size, size).index_add(0, view, weighted.mT @ jacobian)
            + self.block_precision.diag()
        )
        gradient = (
            own.new_zeros(count, size).index_add(
                0, view, (weighted.mT @ residual[..., None]).squeeze(-1)
            )
            + self.block_precision * own
        )
        step, singular = torch.linalg.solve_ex(hessian, gradient)
        return torch.where((singular == 0)[:, None] & step.isfinite(), step, 0.0)

    def _own_cost(self, landing: Landing, residual: Tensor, lands: Tensor, own: Tensor) -> Tensor:
        """(V,) of each view's corners and prior; infinite where one does not land."""
        losses = self.losses(residual, lands)
        return own.new_zeros(len(own)).index_add(
            0, landing.observations.view, losses
        ) + self.prior_of_blocks(own)

    def _losses(self, values: Values, blocks: Tensor) -> Iterator[Tensor]:
        """(m,) of the corners of some views after the other."""
        for landing, poses in self._split(blocks):
            yield self.losses(*landing.residual(landing.rays(values), values, poses))

    def linearise(self, shared: Tensor, blocks: Tensor) -> Iterator[Linearised]:
        values = self.parameters.values(shared)
        for landing, poses in self._split(blocks):
            at = landing.linearise(values, poses)
            size = at.residual.norm(dim=-1)
            if bool((size > self.huber).any()):
                robust = (self.huber / size.clamp_min(self.huber)).sqrt()[
                    :, None, None
                ]  # the square root of Huber's weight
                for part, factor in (
                    (at.residual, robust[..., 0]),
                    (at.jacobian_block, robust),
                    (at.jacobian_shared, robust),
                ):
                    part.mul_(
                        factor
                    )  # made for this: a copy of the last would be as large as all else
            yield at

    def bent(
        self,
        pieces: Iterable[Linearised],
        shared: Tensor,
        blocks: Tensor,
        move: tuple[Tensor, Tensor],
    ) -> Iterator[Tensor]:
        ahead = self.parameters.values(shared + PROBE * move[0])
        parts = zip(
            pieces, self._split(blocks + PROBE * move[1]), self._split(move[1]), strict=True
        )
        for at, (landing, poses), (_, moves) in parts:
            straight = at.jacobian_shared @ move[0] + (
                at.jacobian_block @ moves[landing.observations.view].unsqueeze(-1)
            ).squeeze(-1)
            there, lands = landing.residual(landing.rays(ahead), ahead, poses)
            weight = (self.huber / at.residual.norm(dim=-1, keepdim=True)).clamp_max(
                1.0
            )  # Huber's root once more, of what it has weighted
            bend = 2 / PROBE * ((weight * there - at.residual) / PROBE - straight)
            yield torch.where(lands[:, None] & bend.isfinite(), bend, 0.0)

    def _split(self, blocks: Tensor) -> Iterator[tuple[Landing, Tensor]]:
        begin = 0
        for landing in self.views:
            count = len(landing.observations.names)
            yield landing, blocks[begin : begin + count]
            begin += count
