"""Residuals of corners on their boards and their Jacobian for the solver, from the ray path.

A corner's residual is W (x_cb(p) - x_true), on the board. With W the negative inverse of the
Jacobian of x_cb by the pixel, over the noise, it is the reprojection error to first order, in
standard deviations; with W the identity, the paper's equation 2. It depends on a relief only
through the height and its gradient at the ray's hit point, so these three are differentiated for
each ray (`probes`). All derivatives are in closed form (`optics.derivatives`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from calib.estimation.normal_equations import LinearisedBlocks
from calib.estimation.observations import BATCH_SIZE, Observations
from calib.estimation.parameters import Parameters
from calib.estimation.probes import shared_columns
from calib.optics import rotation
from calib.optics.lens import PIXELS
from calib.optics.params import Values
from calib.optics.path import OWN, Path, Trace
from calib.optics.placement import ByPlacement, Placement
from calib.optics.rays import Rays
from calib.optics.view_blocks import (
    CENTRE,
    FOCAL,
    MOTION,
    VIEW_BLOCKS,
    block_columns,
    blocks_of_size,
)


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
        corners, planes = self.path.planes(
            self.observations.corners, self._placement_of_rows(Placement.of(poses))
        )
        landed, failure = self.path.target(rays, planes, values)
        return self._residuals(landed - corners), failure == 0

    def residual_with_jacobian(
        self, rays: Rays, values: Values, poses: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the residuals, their (M, 2, B) Jacobian by the view parameters, and (M,) true
        where the ray lands.
        """
        trace = None
        if self.path.camera_block:
            trace = self._trace(values, poses, frozenset())
            rays = trace.rays
        placement = Placement.of(poses)
        boards = self._placement_of_rows(placement)
        corners, planes = self.path.planes(self.observations.corners, boards)
        landed, failure, landing = self.path.target.land(rays, planes, values)
        by_rays, by_plane, _ = landing.pull(self._by_landed)
        by_own = trace.pull(by_rays)[OWN] if trace else None
        jacobian = self._view_jacobian(by_plane.of_board(planes, boards), by_own, placement, poses)
        return self._residuals(landed - corners), jacobian, failure == 0

    def linearise(self, values: Values, poses: Tensor, huber: float = math.inf) -> LinearisedBlocks:
        """Return the residuals and their Jacobian by the view parameters and by the shared
        parameters, at the path's values and (V, B) view parameters. Residuals beyond `huber`, and
        their derivatives, are times the square root of Huber's weight.
        """
        observations = self.observations
        names = frozenset(self.parameters.slices())
        trace = self._trace(values, poses, names)
        placement = Placement.of(poses)
        boards = self._placement_of_rows(placement)
        corners, planes = self.path.planes(observations.corners, boards)
        landed, _, landing = self.path.target.land(trace.rays, planes, values)
        residual = self._residuals(landed - corners)
        robust = (huber / residual.norm(dim=-1, keepdim=True)).clamp_max(1.0).sqrt()
        by_rays, by_plane, by_board = landing.pull(self._by_landed * robust, names)
        by = trace.pull(by_rays)
        by_placement = by_plane.of_board(planes, boards)
        jacobian = self._view_jacobian(by_placement, by.get(OWN), placement, poses)
        terms = self.path.linear_terms(observations.pixels, values, observations.exposure, landing)
        columns = shared_columns(self.path, self.parameters, by | by_board, trace, terms, 2)
        return LinearisedBlocks(observations.starts, residual * robust, jacobian, columns)

    def _trace(self, values: Values, poses: Tensor, names: frozenset[str]) -> Trace:
        """Return the rays where they leave the cover, and their derivatives by these names."""
        if self.passed:
            return self.path.trace_on(self.traced, values, names, self.passed)
        observations = self.observations
        cameras = None
        if self.path.camera_block:
            columns = block_columns(self.path.view_blocks)[self.path.camera_block]
            cameras = poses[:, columns][observations.view]
        return self.path.trace_with_derivatives(
            observations.pixels,
            values,
            observations.exposure,
            names,
            cameras=cameras,
            near=self._directions,
        )

    @property
    def _by_landed(self) -> Tensor:
        """The (2, M, 2) derivatives of the residuals by the landing points."""
        return self.weights.transpose(0, 1)

    def _placement_of_rows(self, placement: Placement) -> Placement:
        """Return the placement of each row's board when its line is read."""
        return placement[self.observations.view].at_exposure(self.observations.exposure)

    def _view_jacobian(
        self, by: ByPlacement, by_own: Tensor | None, placement: Placement, poses: Tensor
    ) -> Tensor:
        """Return the (M, 2, B) Jacobian by the parameters of each row's view, from the derivatives
        by the placement of its board, and (2, M, ...) by its own camera.
        """
        view, exposure = self.observations.view, self.observations.exposure
        by_turn, by_shift = by.turn.stacked(), by.shift.stacked()  # (2, M, 3)
        turns = rotation.left_jacobian(poses[:, :3])[view]  # (M, 3, 3)
        by_motion: tuple[Tensor, ...] = ()
        if placement.motion is not None and exposure is None:
            by_motion = (by_shift.new_zeros(*by_shift.shape[:2], VIEW_BLOCKS[MOTION]),)
        elif placement.motion is not None and exposure is not None:
            line = exposure.line[:, None]
            spin = placement.motion[view][:, :3] * line
            by_spin = _rows_times(by_turn, rotation.left_jacobian(spin)) * line
            by_motion = by_spin, by_shift * line
            turns = rotation.matrix(spin) @ turns
        columns = [_rows_times(by_turn, turns), by_shift, *by_motion]
        columns += [extra for extra in (by.flex, by_own) if extra is not None]
        return torch.cat([column.transpose(0, 1) for column in columns], -1)

    def _residuals(self, offset: Tensor) -> Tensor:
        return (self.weights @ offset.unsqueeze(-1)).squeeze(-1)


def _rows_times(rows: Tensor, matrices: Tensor) -> Tensor:
    """Return the (k, M, n) products of (k, M, 3) rows with the (M, 3, n) matrix of each."""
    x, y, z = rows.unsqueeze(-1).unbind(-2)
    first, second, third = matrices.unbind(-2)
    products: Tensor = x * first + y * second + z * third
    return products


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
    return torch.cat(
        [_pixel_weights(path, values, batch, poses, sigma) for batch in observations.batches()]
    )


def _pixel_weights(
    path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float
) -> Tensor:
    """Return the `pixel_weights` of few corners."""
    blocks = blocks_of_size(poses.shape[1])
    cameras = [
        poses[:, columns]
        for name, columns in block_columns(blocks).items()
        if name in (FOCAL, CENTRE)
    ]
    trace = path.trace_with_derivatives(
        observations.pixels,
        values,
        observations.exposure,
        frozenset(),
        cameras=cameras[0][observations.view] if cameras else None,
    )
    boards = Placement.of(poses)[observations.view].at_exposure(observations.exposure)
    planes = path.planes(observations.corners, boards)[1]
    landed, _, landing = path.target.land(trace.rays, planes, values)
    identity = torch.eye(2).to(landed)[:, None].expand(2, *landed.shape)
    jacobian = trace.pull(landing.pull(identity)[0])[PIXELS].transpose(0, 1)
    weights: Tensor = (
        torch.linalg.inv_ex(jacobian).inverse * -(observations.weight / sigma)[:, None, None]
    )
    return weights if observations.whitening is None else observations.whitening @ weights
