"""Where the corners of some views land on their boards: residuals and their Jacobian for the
solver, from the ray path.

A corner's residual is W (x_cb(p) - x_true), on the board. With W the inverse of the Jacobian of
x_cb by the pixel, negated and over the noise, it is the reprojection error to first order, in
standard deviations; with W the identity, the paper's equation 2. It depends on a relief only
through the height and its gradient at the ray's own hit, so these three are differentiated for each
ray (`probed`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearised
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.probed import Probed, Seen
from calib.optics import rotation
from calib.optics.board_target import MOTION, VIEW_BLOCKS, Placement
from calib.optics.params import LINE, NEAR, Values
from calib.optics.path import Path, row_derivatives
from calib.optics.rays import Rays

ROWS = 8192
"""Corners whose derivatives are in memory at once: 0.1 GB with 16x16 centres."""


@dataclass(frozen=True, slots=True)
class Landing:
    """The corners of some consecutive views."""

    path: Path
    parameters: Parameters
    """What is estimated of the path."""
    observations: Observations
    held: Rays
    """As they arrive at the first stage that an estimated parameter changes."""
    passed: int
    """How many stages that is after; 0 where even the lens changes."""
    weights: Tensor
    """(M, 2, 2) W, from metres on the board to the residual's unit; held."""

    def rays(self, values: Values) -> Rays:
        """As they leave the cover: what boards are told by, wherever they are."""
        values = self.observations.with_times(values)
        if self.passed:
            return self.path.trace_from(self.held, values, self.passed)
        return self.path.trace(self.observations.pixels, {**values, NEAR: self._near})

    @property
    def _near(self) -> Tensor:
        """(M, 2) where the held rays go."""
        way = self.held.direction
        return torch.where(
            (self.held.failure == 0)[:, None],
            torch.stack([way.x, way.y], -1) / way.z[:, None],
            torch.nan,
        )

    def residual(self, rays: Rays, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
        """The (M, 2) residuals of rays for (V, B) own parameters of views, and (M,) bool whether
        each ray lands.
        """
        seen = self.observations
        values = seen.with_times(values)
        landed, failure = self.path.target(
            rays, Placement.of(poses)[seen.view].at_line(values.get(LINE)), values
        )
        return self._weighted(landed), failure == 0

    def by_own(self, rays: Rays, values: Values, poses: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The residuals, their (M, 2, B) Jacobian by the views' own parameters, nearly
        (`Target.intersect_with_derivatives`), and (M,) bool whether each ray lands.
        """
        values = self.observations.with_times(values)
        placed = Placement.of(poses)
        landed, failure, changes = self.path.target.intersect_with_derivatives(
            rays, placed[self.observations.view].at_line(values.get(LINE)), values
        )
        by = [(self.weights @ change.flatten(2)).reshape(change.shape) for change in changes]
        return self._weighted(landed), self._joined(by, placed, poses, values), failure == 0

    def linearise(self, values: Values, poses: Tensor) -> Linearised:
        """Residuals and Jacobian, by the views' own parameters and by the shared ones, at the
        path's values and (V, B) own ones.
        """
        seen = self.observations
        values = seen.with_times(values)
        placed, leaves = self._placed(poses, values)
        target = self.path.target
        probed = Probed.of(
            self.path,
            self.parameters,
            values,
            len(seen.pixels),
            (*self.path.adjustments, *target.bends, *target.prints),
        )
        with torch.enable_grad():
            rays = self.rays(probed.values)
            landed, _ = target(rays, _placement(leaves), probed.values)
            missed = self._weighted(landed)
            found = row_derivatives(missed, [*leaves, *probed.leaves.values()])
        parts = self.path.linear_terms(seen.pixels, values, landed.detach())
        columns = probed.columns(found[len(leaves) :], Seen(seen.pixels, rays, values, parts))
        shared = missed.new_zeros(*missed.shape, 0) if columns is None else columns
        return Linearised(
            seen.starts,
            missed.detach(),
            self._joined(found[: len(leaves)], placed, poses, values),
            shared,
        )

    def _placed(self, poses: Tensor, values: Values) -> tuple[Placement, list[Tensor]]:
        """Where each view's board is, and, to be differentiated by, each ray's: its rotation, its
        place, and its flex where it has one.
        """
        placed = Placement.of(poses)
        own = placed[self.observations.view].at_line(values.get(LINE))
        return placed, [
            part.detach().requires_grad_()
            for part in (own.turn, own.shift, *([] if own.flex is None else [own.flex]))
        ]

    def _joined(
        self, by_leaves: Sequence[Tensor], placed: Placement, poses: Tensor, values: Values
    ) -> Tensor:
        """(M, 2, B) by the own parameters of each row's view, from the derivatives by what
        `_placed` has.
        """
        return torch.cat(
            [self._by_pose(by_leaves[0], by_leaves[1], placed, poses, values), *by_leaves[2:]], -1
        )

    def _by_pose(
        self, by_turn: Tensor, by_shift: Tensor, placed: Placement, poses: Tensor, values: Values
    ) -> Tensor:
        """(M, 2, 6 or 12) Jacobian by the pose of each row's view, and by its motion where there is
        one, from those by its board's rotation (M, 2, 3, 3) and place (M, 2, 3).
        """
        view = self.observations.view
        turns = rotation.derivatives(poses[:, :3], placed.turn)[view]  # (M, 3, 3, 3)
        line = values.get(LINE)
        if placed.motion is None or line is None:
            still = by_shift.new_zeros(
                *by_shift.shape[:2], 0 if placed.motion is None else VIEW_BLOCKS[MOTION]
            )
            return torch.cat([by_turn.flatten(2) @ turns.flatten(2).mT, by_shift, still], -1)
        moved = placed.motion[view][:, :3] * line[:, None]
        turned = rotation.matrix(moved)
        spins = (
            rotation.derivatives(moved, turned)
            @ placed.turn[view].unsqueeze(1)
            * line[:, None, None, None]
        )
        by_rotation, by_spin = (
            by_turn.flatten(2) @ part.flatten(2).mT for part in (turned.unsqueeze(1) @ turns, spins)
        )
        return torch.cat([by_rotation, by_shift, by_spin, by_shift * line[:, None, None]], -1)

    def _weighted(self, landed: Tensor) -> Tensor:
        return (self.weights @ (landed - self.observations.corners).unsqueeze(-1)).squeeze(-1)


def _placement(leaves: Sequence[Tensor]) -> Placement:
    turn, shift, *flex = leaves
    return Placement(turn, shift, flex=flex[0] if flex else None)


def landings(
    path: Path,
    parameters: Parameters,
    observations: Observations,
    weights: Tensor,
    near: Values | None = None,
) -> Iterator[Landing]:
    """The landings of all views, some views at a time, with the stages traced that stay as they
    are.

    Args:
        near: all values, near those that residuals will be asked at; None: the parameters' origin.
    """
    moves = set(parameters.slices())
    still = 0
    for stage in path.stages:
        if moves & {param.name for param in stage.params} or (moves and path.adjustments):
            break
        still += 1
    for views in _runs(observations):
        some = observations.run(views)
        held = replace(path, cover=path.cover[: max(still - 1, 0)]).trace(
            some.pixels, some.with_times(near or parameters.origin)
        )
        first, last = (int(observations.starts[v]) for v in (views.start, views.stop))
        yield Landing(path, parameters, some, held, still, weights[first:last])


def _runs(observations: Observations) -> Iterator[range]:
    """Consecutive views of about ROWS corners together."""
    starts = observations.starts.tolist()
    begin = 0
    for view, (_, end) in enumerate(pairwise(starts)):
        if view + 1 == len(starts) - 1 or end - starts[begin] >= ROWS:
            yield range(begin, view + 1)
            begin = view + 1


def pixel_weights(
    path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float
) -> Tensor:
    """(M, 2, 2) W that makes a residual on the board the reprojection error to first order, in
    standard deviations.

    e_px = -(d x_cb / d p)^-1 (x_cb(p) - x_true); sigma is px per axis, over each corner's own
    weight.
    """
    pixels = observations.pixels.detach().requires_grad_()
    with torch.enable_grad():
        landed, _ = path.land(pixels, observations.with_times(values), poses[observations.view])
        (jacobian,) = row_derivatives(landed, [pixels])
    weights: Tensor = (
        torch.linalg.inv_ex(jacobian).inverse * -(observations.weight / sigma)[:, None, None]
    )
    return weights
