"""The solver's problem for a rig: the corners of all cameras as a function of the cameras, their
mountings, and one placement of the board for all cameras that saw it at the same time.

A camera's own problem (`LandingProblem`) has blocks for its views, in the numbers of the board's
pose in that camera. That pose is the mounting times the placement, so 6x6 derivatives turn each
view's block into blocks by the camera, its mounting and the placement. Blocks of one placement add
up. The solver then eliminates the placements by the Schur complement: time and memory grow linearly
with their number, and no dense Jacobian of all cameras is ever built.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearisation
from calib.estimation.normal_equations import NormalEquations
from calib.estimation.objective import LandingProblem
from calib.rig.pose_terms import PoseTerms
from calib.rig.poses import ComposedPoses, compose, compose_with_derivatives

MIN_BASELINE = 1e-9
"""m: below this, a baseline has no direction."""


@dataclass(frozen=True, slots=True)
class CameraProblem:
    """A camera's views, and the places of its numbers among those of the rig."""

    landing: LandingProblem
    """The problem of this camera alone; its blocks are T_camera_board of its views."""
    columns: Tensor
    """(S_c,) int64: the entries of the rig's vector that are this camera's vector."""
    nominal: Tensor
    """(6,) the mounting at the zero vector: T_camera_reference, or that of the camera in whose
    frame the boards are placed.
    """
    mounting: Tensor
    """(6,) int64: the entries of the rig's vector that are added to it; (0,) for the reference."""
    placement: Tensor
    """(V,) int64: the placement of each view."""
    terms: PoseTerms | None = None
    """Further numbers of the rig's vector that move the boards of this camera."""

    @property
    def moving(self) -> Tensor:
        """(m,) int64: the entries of the rig's vector that move this camera's boards."""
        return torch.cat([self.mounting, self.terms.entries]) if self.terms else self.mounting

    def by_moving(self, composed: ComposedPoses) -> Tensor:
        """Return the (V, B, m) derivatives of the poses by these entries."""
        slopes = [composed.by_mounting[..., : len(self.mounting)]]
        if self.terms:
            slopes += [
                composed.by_mounting @ self.terms.by_mounting
                + composed.by_placement[..., :6] @ self.terms.by_placement
            ]
        return torch.cat(slopes, -1)

    def mounting_at(self, shared: Tensor) -> Tensor:
        """Return the (6,) mounting at the rig's (S,) vector."""
        return self.nominal + shared[self.mounting] if len(self.mounting) else self.nominal

    def compose(self, shared: Tensor, placements: Tensor) -> Tensor:
        """Return the (V, B) poses of the views."""
        return compose(*self._placed(shared, placements))

    def compose_with_derivatives(self, shared: Tensor, placements: Tensor) -> ComposedPoses:
        """Return the poses of the views with their derivatives."""
        return compose_with_derivatives(*self._placed(shared, placements))

    def _placed(self, shared: Tensor, placements: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mounting and the (V, B) placements of the views."""
        mounting, places = self.mounting_at(shared), placements[self.placement]
        return self.terms.moved(mounting, places, shared) if self.terms else (mounting, places)


@dataclass(frozen=True, slots=True)
class BaselinePrior:
    """A measured distance between two cameras, one of which is the reference."""

    camera: int
    """The index of the other camera."""
    length: float
    """m"""
    sigma: float
    """m"""

    def row(self, mounting: Tensor) -> tuple[float, Tensor]:
        """Return the residual, in standard deviations, and its (6,) derivatives by the mounting."""
        shift = mounting[3:]
        length = float(shift.norm())
        slope = torch.zeros_like(mounting)
        slope[3:] = shift / max(length, MIN_BASELINE) / self.sigma
        return (length - self.length) / self.sigma, slope


@dataclass(frozen=True, slots=True)
class RigProblem:
    """The problem of all cameras; its blocks are the (P, B) placements T_reference_board, each with
    the bend of its board if boards bend.
    """

    cameras: tuple[CameraProblem, ...]
    """Their own problems have no prior on a view's numbers: several views show one placement."""
    precision: Tensor
    """(S, S) precision of the prior on the rig's vector."""
    block_precision: Tensor
    """(B,) precision of the prior on a placement's numbers: 0 for its pose."""
    baseline: BaselinePrior | None = None
    mounting: tuple[Tensor, Tensor] | None = None
    """That of the baseline's camera: (6,) at the zero vector, and the (6,) int64 entries of the
    rig's vector that are added to it. A camera behind a shared cover has its boards in the frame of
    another camera, but its baseline is its own.
    """

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        return self._baseline_cost(shared) + sum(
            camera.landing.cost(shared[camera.columns], camera.compose(shared, blocks))
            for camera in self.cameras
        )

    def linearisation(self, shared: Tensor, blocks: Tensor) -> Linearisation:
        return RigLinearisation.of(self, shared, blocks)

    def inner_step(self, shared: Tensor, blocks: Tensor) -> tuple[Tensor, float]:
        """Take a Gauss-Newton step of each placement by itself where it lowers the cost of the
        corners that all cameras saw of it.
        """
        hessian = self.block_precision.diag().repeat(len(blocks), 1, 1)
        gradient = self.block_precision * blocks
        costs = self._block_prior(blocks)
        traced = []
        for camera in self.cameras:
            landing = camera.landing
            values = landing.valid_values(shared[camera.columns])
            if values is None:
                return blocks, math.inf
            composed = camera.compose_with_derivatives(shared, blocks)
            for block, views, poses in _split(landing, composed.poses):
                rays = block.rays(values, poses)
                residual, jacobian, lands = block.residual_with_jacobian(rays, values, poses)
                view_hessian, view_gradient = landing.view_equations(block, residual, jacobian)
                slope = composed.by_placement[views]
                placement = camera.placement[views]
                hessian.index_add_(0, placement, slope.mT @ view_hessian @ slope)
                step = (slope.mT @ view_gradient.unsqueeze(-1)).squeeze(-1)
                gradient.index_add_(0, placement, step)
                costs.index_add_(0, placement, landing.view_costs(block, residual, lands, poses))
                traced.append((camera, block, views, rays, values))
        steps, singular = torch.linalg.solve_ex(hessian, gradient)
        usable = (singular == 0)[:, None] & steps.isfinite()
        stepped = blocks - torch.where(usable, steps, 0.0)
        new_costs = self._block_prior(stepped)
        for camera, block, views, rays, values in traced:
            poses = camera.compose(shared, stepped)[views]
            residual, lands = block.residual(rays, values, poses)
            view_costs = camera.landing.view_costs(block, residual, lands, poses)
            new_costs.index_add_(0, camera.placement[views], view_costs)
        better = new_costs < costs
        best = torch.where(better[:, None], stepped, blocks)
        total = (torch.where(better, new_costs, costs) - self._block_prior(best)).sum()
        return best, float(total) + self._baseline_cost(shared)

    def baseline_row(self, shared: Tensor) -> tuple[float, Tensor, Tensor] | None:
        """Return the residual of the measured baseline, its (6,) derivatives, and the (6,) entries
        of the vector by which they are; None if no baseline was measured.
        """
        if not self.baseline or not self.mounting:
            return None
        nominal, entries = self.mounting
        return *self.baseline.row(nominal + shared[entries]), entries

    def _block_prior(self, blocks: Tensor) -> Tensor:
        """Return the (P,) prior cost of the (P, B) placements."""
        return blocks**2 @ self.block_precision

    def _baseline_cost(self, shared: Tensor) -> float:
        row = self.baseline_row(shared)
        return row[0] ** 2 if row else 0.0


@dataclass(frozen=True, slots=True)
class RigLinearisation:
    """The linearised rows of all cameras."""

    cameras: tuple[CameraProblem, ...]
    composed: tuple[ComposedPoses, ...]
    linearised: tuple[Linearisation, ...]
    """The linearisation of each camera alone."""
    equations: NormalEquations

    @staticmethod
    def of(problem: RigProblem, shared: Tensor, placements: Tensor) -> RigLinearisation:
        composed = tuple(
            camera.compose_with_derivatives(shared, placements) for camera in problem.cameras
        )
        linearised = tuple(
            camera.landing.linearisation(shared[camera.columns], poses.poses)
            for camera, poses in zip(problem.cameras, composed, strict=True)
        )
        equations = _zero_equations(placements, len(shared))
        for camera, poses, rows in zip(problem.cameras, composed, linearised, strict=True):
            equations = _add_camera(equations, camera, poses, rows.equations)
        if row := problem.baseline_row(shared):
            residual, slope, entries = row
            equations.hessian_shared[entries[:, None], entries] += torch.outer(slope, slope)
            equations.gradient_shared[entries] += residual * slope
        return RigLinearisation(problem.cameras, composed, linearised, equations)

    def curvature_gradient(self, move: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Return the products of the Jacobian with the second derivatives of the residuals along a
        (S,) and (P, B) move. The views' poses move linearly: the curvature of their composition is
        left out.
        """
        by_shared = torch.zeros_like(self.equations.gradient_shared)
        by_block = torch.zeros_like(self.equations.gradient_block)
        shared, blocks = move
        for camera, poses, rows in zip(self.cameras, self.composed, self.linearised, strict=True):
            pose_move = (poses.by_placement @ blocks[camera.placement].unsqueeze(-1)).squeeze(-1)
            if len(camera.moving):
                pose_move = pose_move + camera.by_moving(poses) @ shared[camera.moving]
            by_pose, by_camera = rows.curvature_gradient((shared[camera.columns], pose_move))
            by_shared.index_add_(0, camera.columns, by_camera)
            if len(camera.moving):
                turned = (camera.by_moving(poses).mT @ by_pose.unsqueeze(-1)).squeeze(-1)
                by_shared.index_add_(0, camera.moving, turned.sum(0))
            turned = (poses.by_placement.mT @ by_pose.unsqueeze(-1)).squeeze(-1)
            by_block.index_add_(0, camera.placement, turned)
        return by_block, by_shared


def _zero_equations(placements: Tensor, shared: int) -> NormalEquations:
    count, size = placements.shape
    return NormalEquations(
        hessian_block=placements.new_zeros(count, size, size),
        hessian_cross=placements.new_zeros(count, size, shared),
        hessian_shared=placements.new_zeros(shared, shared),
        gradient_block=torch.zeros_like(placements),
        gradient_shared=placements.new_zeros(shared),
        sum_of_squares=0.0,
    )


def _add_camera(
    total: NormalEquations, camera: CameraProblem, poses: ComposedPoses, rows: NormalEquations
) -> NormalEquations:
    """Add the equations of one camera to those of the rig, in place, and return these."""
    columns = camera.columns
    shared, cross = rows.hessian_shared, rows.hessian_cross
    gradient = rows.gradient_shared
    if len(camera.moving):
        columns = torch.cat([columns, camera.moving])
        by_moving = camera.by_moving(poses)
        by_pose = rows.hessian_block @ by_moving  # (V, 6, m)
        mixed = (by_moving.mT @ cross).sum(0)  # (m, S_c)
        square = (by_moving.mT @ by_pose).sum(0)
        shared = torch.cat([torch.cat([shared, mixed.mT], 1), torch.cat([mixed, square], 1)])
        cross = torch.cat([cross, by_pose], 2)
        moving_gradient = by_moving.mT @ rows.gradient_block.unsqueeze(-1)
        gradient = torch.cat([gradient, moving_gradient.sum(0).squeeze(-1)])
    slope = poses.by_placement
    total.hessian_shared.index_put_((columns[:, None], columns), shared, accumulate=True)
    total.gradient_shared.index_put_((columns,), gradient, accumulate=True)
    places = camera.placement[:, None, None], torch.arange(slope.shape[2])[:, None], columns
    total.hessian_cross.index_put_(places, slope.mT @ cross, accumulate=True)
    total.hessian_block.index_add_(0, camera.placement, slope.mT @ rows.hessian_block @ slope)
    view_gradient = (slope.mT @ rows.gradient_block.unsqueeze(-1)).squeeze(-1)
    total.gradient_block.index_add_(0, camera.placement, view_gradient)
    return NormalEquations(
        hessian_block=total.hessian_block,
        hessian_cross=total.hessian_cross,
        hessian_shared=total.hessian_shared,
        gradient_block=total.gradient_block,
        gradient_shared=total.gradient_shared,
        sum_of_squares=total.sum_of_squares + rows.sum_of_squares,
    )


def _split(landing: LandingProblem, poses: Tensor) -> Iterator[tuple]:
    """Yield each residual block, the slice of its views, and their (v, B) poses."""
    start = 0
    for block, block_poses in landing.split(poses):
        stop = start + len(block_poses)
        yield block, slice(start, stop), block_poses
        start = stop


def rig_precision(cameras: Sequence[tuple[Tensor, Tensor]], count: int) -> Tensor:
    """Return the (S, S) precision of the prior on a rig's vector of S entries.

    Args:
        cameras: the (S_c,) columns of each camera, and the (S_c, S_c) precision of its prior. An
            entry that several cameras share has the prior of the first.
    """
    total = cameras[0][1].new_zeros(count, count)
    occupied = torch.zeros(count, dtype=torch.bool)
    for columns, precision in cameras:
        free = ~occupied[columns]
        entries = columns[free]
        total[entries[:, None], entries] = precision[free][:, free]
        occupied[columns] = True
    return total
