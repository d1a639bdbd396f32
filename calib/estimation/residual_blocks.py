"""Residuals of corners on their boards and their Jacobian for the solver, from the ray path.

A corner's residual is W (x_cb(p) - x_true), on the board. With W the negative inverse of the
Jacobian of x_cb by the pixel, over the noise, it is the reprojection error to first order, in
standard deviations; with W the identity, the paper's equation 2. It depends on a relief only
through the height and its gradient at the ray's hit point, so these three are differentiated for
each ray (`probes`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from calib.estimation.normal_equations import LinearisedBlocks
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.probes import ProbedValues, TracedRows
from calib.optics import rotation
from calib.optics.board_target import MOTION, VIEW_BLOCKS, Placement, block_columns
from calib.optics.params import Values
from calib.optics.path import Path, row_derivatives, with_own_camera
from calib.optics.rays import Rays

BATCH_SIZE = 8192
"""The number of corners whose derivatives are in memory together: 0.1 GB with 16x16 centres."""


@dataclass(frozen=True, slots=True)
class ResidualBlock:
    """The corners of some consecutive views."""

    path: Path
    parameters: Parameters
    """The estimated parameters of the path."""
    observations: Observations
    traced: Rays
    """The rays at the first stage that an estimated parameter changes."""
    passed: int
    """The number of stages before it; 0 if even the lens changes."""
    weights: Tensor
    """(M, 2, 2) W, from metres on the board to the residual's unit; constant."""

    def rays(self, values: Values, poses: Tensor) -> Rays:
        """Return the rays where they leave the cover, for (V, B) view parameters. They do not
        depend on the boards' poses.
        """
        if not self.path.camera_block:
            return self._rays(values)
        return self._rays(self.path.values_of_views(values, poses[self.observations.view]))

    def _rays(self, values: Values) -> Rays:
        if self.passed:
            return self.path.trace_from(self.traced, values, self.passed)
        observations = self.observations
        return self.path.trace(
            observations.pixels, values, observations.exposure, near=self._directions
        )

    @property
    def _directions(self) -> Tensor:
        """The (M, 2) x and y at z = 1 of the directions of `traced`; NaN for a failed ray."""
        direction = self.traced.direction
        return torch.where(
            (self.traced.failure == 0)[:, None],
            torch.stack([direction.x, direction.y], -1) / direction.z[:, None],
            torch.nan,
        )

    def residual(self, rays: Rays, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Return the (M, 2) residuals of rays for (V, B) view parameters, and (M,) true where the
        ray lands.
        """
        observations = self.observations
        placement = Placement.of(poses)[observations.view].at_exposure(observations.exposure)
        landed, failure = self.path.target(rays, placement, values)
        return self._residuals(landed), failure == 0

    def residual_with_jacobian(
        self, rays: Rays, values: Values, poses: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the residuals, their approximate (M, 2, B) Jacobian by the view parameters
        (`Target.intersect_with_derivatives`), and (M,) true where the ray lands.
        """
        if self.path.camera_block:
            return self._traced_jacobian(values, poses)
        observations = self.observations
        placement = Placement.of(poses)
        landed, failure, derivatives = self.path.target.intersect_with_derivatives(
            rays, placement[observations.view].at_exposure(observations.exposure), values
        )
        weighted = [
            (self.weights @ derivative.flatten(2)).reshape(derivative.shape)
            for derivative in derivatives
        ]
        jacobian = self._view_jacobian(weighted, placement, poses)
        return self._residuals(landed), jacobian, failure == 0

    def _traced_jacobian(self, values: Values, poses: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the same where views have cameras of their own: the rays differ as well."""
        placement, leaves = self._placements(poses)
        with torch.enable_grad():
            rays = self._rays(self._of_views(values, leaves))
            landed, failure = self.path.target(rays, self._placement(leaves), values)
            residual = self._residuals(landed)
            derivatives = row_derivatives(residual, leaves)
        jacobian = self._view_jacobian(derivatives, placement, poses)
        return residual.detach(), jacobian, failure == 0

    def linearise(self, values: Values, poses: Tensor) -> LinearisedBlocks:
        """Return the residuals and their Jacobian by the view parameters and by the shared
        parameters, at the path's values and (V, B) view parameters.
        """
        observations = self.observations
        exposure = observations.exposure
        placement, leaves = self._placements(poses)
        target = self.path.target
        probed = ProbedValues.of(
            self.path,
            self.parameters,
            values,
            len(observations.pixels),
            (*self.path.adjustments, *target.bends, *target.prints),
        )
        with torch.enable_grad():
            rays = self._rays(self._of_views(probed.values, leaves))
            landed, _ = target(rays, self._placement(leaves), probed.values)
            residual = self._residuals(landed)
            derivatives = row_derivatives(residual, [*leaves, *probed.leaves.values()])
        terms = self.path.linear_terms(observations.pixels, values, exposure, landed.detach())
        rows = TracedRows(observations.pixels, rays, values, exposure, terms)
        columns = probed.columns(derivatives[len(leaves) :], rows)
        shared = residual.new_zeros(*residual.shape, 0) if columns is None else columns
        return LinearisedBlocks(
            observations.starts,
            residual.detach(),
            self._view_jacobian(derivatives[: len(leaves)], placement, poses),
            shared,
        )

    def _placements(self, poses: Tensor) -> tuple[Placement, list[Tensor]]:
        """Return the placement of each view's board, and the tensors by which the residuals are
        differentiated: the rotation, the translation and, if there is one, the flex of each ray's
        board, and the numbers of its own camera.
        """
        placement = Placement.of(poses)
        observations = self.observations
        by_row = placement[observations.view].at_exposure(observations.exposure)
        leaves = [by_row.turn, by_row.shift, *([] if by_row.flex is None else [by_row.flex])]
        if self.path.camera_block:
            columns = block_columns(self.path.view_blocks)[self.path.camera_block]
            leaves.append(poses[:, columns][observations.view])
        return placement, [leaf.detach().requires_grad_() for leaf in leaves]

    def _placement(self, leaves: Sequence[Tensor]) -> Placement:
        """Return the placement of each ray's board, from the leaves of `_placements`."""
        flex = leaves[2] if self.path.target.flex else None
        return Placement(leaves[0], leaves[1], flex=flex)

    def _of_views(self, values: Values, leaves: Sequence[Tensor]) -> Values:
        """Return the values with each ray's own camera, from the same leaves."""
        return with_own_camera(values, leaves[-1]) if self.path.camera_block else values

    def _view_jacobian(
        self, by_leaves: Sequence[Tensor], placement: Placement, poses: Tensor
    ) -> Tensor:
        """Return the (M, 2, B) Jacobian by the parameters of each row's view, from the derivatives
        by the leaves of `_placements`.
        """
        by_pose = self._by_pose(by_leaves[0], by_leaves[1], placement, poses)
        return torch.cat([by_pose, *by_leaves[2:]], -1)

    def _by_pose(
        self, by_turn: Tensor, by_shift: Tensor, placement: Placement, poses: Tensor
    ) -> Tensor:
        """Return the (M, 2, 6 or 12) Jacobian by the pose of each row's view and, if views have
        one, by its motion, from the derivatives by its board's rotation (M, 2, 3, 3) and
        translation (M, 2, 3).
        """
        view = self.observations.view
        turns = rotation.derivatives(poses[:, :3], placement.turn)[view]  # (M, 3, 3, 3)
        exposure = self.observations.exposure
        if placement.motion is None or exposure is None:
            by_motion = by_shift.new_zeros(
                *by_shift.shape[:2], 0 if placement.motion is None else VIEW_BLOCKS[MOTION]
            )
            return torch.cat([by_turn.flatten(2) @ turns.flatten(2).mT, by_shift, by_motion], -1)
        line = exposure.line
        spin = placement.motion[view][:, :3] * line[:, None]
        spin_matrix = rotation.matrix(spin)
        spins = (
            rotation.derivatives(spin, spin_matrix)
            @ placement.turn[view].unsqueeze(1)
            * line[:, None, None, None]
        )
        turns = spin_matrix.unsqueeze(1) @ turns
        by_rotation = by_turn.flatten(2) @ turns.flatten(2).mT
        by_spin = by_turn.flatten(2) @ spins.flatten(2).mT
        return torch.cat([by_rotation, by_shift, by_spin, by_shift * line[:, None, None]], -1)

    def _residuals(self, landed: Tensor) -> Tensor:
        return (self.weights @ (landed - self.observations.corners).unsqueeze(-1)).squeeze(-1)


def make_residual_blocks(
    path: Path,
    parameters: Parameters,
    observations: Observations,
    weights: Tensor,
    start: Values | None = None,
) -> Iterator[ResidualBlock]:
    """Yield the residual blocks of all views, some views at a time, with the rays traced up to the
    first stage that changes.

    Args:
        start: all values, close to those of the later residuals; None means the parameters' origin.
    """
    estimated = set(parameters.slices())
    constant = 0
    for stage in path.stages:
        read = {param.name for param in stage.params}
        if estimated & read or path.camera_block or (estimated and path.adjustments):
            break
        constant += 1
    for views in _batches(observations):
        batch = observations.view_range(views)
        traced = replace(path, cover=path.cover[: max(constant - 1, 0)]).trace(
            batch.pixels, start or parameters.origin, batch.exposure
        )
        first = int(observations.starts[views.start])
        last = int(observations.starts[views.stop])
        yield ResidualBlock(path, parameters, batch, traced, constant, weights[first:last])


def _batches(observations: Observations) -> Iterator[range]:
    """Yield ranges of consecutive views with about BATCH_SIZE corners each."""
    starts = observations.starts.tolist()
    first = 0
    for view, (_, end) in enumerate(pairwise(starts)):
        if view + 1 == len(starts) - 1 or end - starts[first] >= BATCH_SIZE:
            yield range(first, view + 1)
            first = view + 1


def pixel_weights(
    path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float
) -> Tensor:
    """Return the (M, 2, 2) W that turns a residual on the board into the reprojection error to
    first order, in standard deviations.

    e_px = -(d x_cb / d p)^-1 (x_cb(p) - x_true); sigma is px per axis, divided by each corner's
    weight.
    """
    pixels = observations.pixels.detach().requires_grad_()
    with torch.enable_grad():
        landed, _ = path.land(pixels, values, poses[observations.view], observations.exposure)
        (jacobian,) = row_derivatives(landed, [pixels])
    weights: Tensor = (
        torch.linalg.inv_ex(jacobian).inverse * -(observations.weight / sigma)[:, None, None]
    )
    return weights if observations.whitening is None else observations.whitening @ weights
