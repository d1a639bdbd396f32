"""Where the corners of some views land on their boards: residuals and derivatives for the solver, from the ray path.

A corner's residual is W (x_cb(p) - x_true), on the board. With W the inverse of the derivative of x_cb by the pixel, negated and over
the noise, it is the reprojection error to first order, in standard deviations; with W the identity, the paper's equation 2. It depends
on a relief only through the height and two slopes at the ray's own hit, so these three are differentiated for each ray, and the basis
spreads them over all amplitudes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Linearised
from calib.estimation.observations import Observations
from calib.optics import rotation
from calib.optics.board_target import Placement
from calib.optics.params import LINE, Values
from calib.optics.path import Path, by_row
from calib.optics.rays import Rays
from calib.optics.relief import PROBES

ROWS = 8192
"""Corners whose derivatives are in memory at once: 0.1 GB with 16x16 centres."""


@dataclass(frozen=True, slots=True)
class Landing:
    """The corners of some consecutive views."""

    path: Path
    moving: tuple[str, ...]
    """The scalar numbers of the path that are estimated."""
    relief_moves: bool
    observations: Observations
    held: Rays
    """As they arrive at the first stage that an estimated number changes."""
    passed: int
    """How many stages that is after; 0 where even the lens changes."""
    weights: Tensor
    """(M, 2, 2) W, from metres on the board to the residual's unit; held."""

    def residual(self, values: Values, poses: Tensor) -> tuple[Tensor, Tensor]:
        """The (M, 2) residuals for (V, 6) poses, and (M,) bool whether each ray lands."""
        seen = self.observations
        values = seen.told(values)
        landed, failure = self.path.target(self._rays(values), Placement.of(poses)[seen.view].during(values.get(LINE)), values)
        return self._weighted(landed), failure == 0

    def linearise(self, values: Values, poses: Tensor, scales: Tensor) -> Linearised:
        """Residuals and derivatives by the poses, by the relief's amplitudes (row by row), then by the moving numbers over their scales.

        Args:
            values: where.
            poses: (V, 6)
            scales: one for each moving number, and each entry of one that has several.
        """
        seen = self.observations
        values = seen.told(values)
        rows = len(seen.pixels)
        placed = Placement.of(poses)
        own = placed[seen.view].during(values.get(LINE))
        leaves = [own.turn.detach().requires_grad_(), own.shift.detach().requires_grad_()]
        numbers = [values[name].expand(rows, *values[name].shape).clone().requires_grad_() for name in self.moving]
        probes = [torch.zeros_like(seen.weight, requires_grad=True) for _ in PROBES] if self.relief_moves else []
        with torch.enable_grad():
            probed = {**values, **dict(zip(self.moving, numbers, strict=True)), **dict(zip(PROBES, probes, strict=False))}
            rays = self._rays(probed)
            landed, _ = self.path.target(rays, Placement(*leaves), probed)
            by_turn, by_shift, *rest = by_row(landed, [*leaves, *probes, *numbers])
        columns: list[Tensor] = []
        by_probe, by_number = rest[: len(probes)], rest[len(probes) :]
        if probes:
            columns.append(self._spread(self.weights @ torch.stack(by_probe, -1), rays, values))
        if numbers:
            columns.append(self.weights @ (joined(by_number) * scales))
        shared = torch.cat(columns, -1) if columns else landed.new_zeros(rows, 2, 0)
        jacobian_block = self._jacobian_block(by_turn, by_shift, placed, poses, values)
        return Linearised(seen.starts, self._weighted(landed.detach()), self.weights @ jacobian_block, shared)

    def _jacobian_block(self, by_turn: Tensor, by_shift: Tensor, placed: Placement, poses: Tensor, values: Values) -> Tensor:
        """(M, 2, B) derivatives by the numbers of each row's view, from those by its board's rotation (M, 2, 3, 3) and place (M, 2, 3)."""
        view = self.observations.view
        turns = rotation.slopes(poses[:, :3], placed.turn)[view]  # (M, 3, 3, 3)
        line = values.get(LINE)
        if placed.motion is None or line is None:
            still = by_shift.new_zeros(*by_shift.shape[:2], poses.shape[1] - 6)
            return torch.cat([by_turn.flatten(2) @ turns.flatten(2).mT, by_shift, still], -1)
        moved = placed.motion[view][:, :3] * line[:, None]
        turned = rotation.matrix(moved)
        spins = rotation.slopes(moved, turned) @ placed.turn[view].unsqueeze(1) * line[:, None, None, None]
        by_rotation, by_spin = (by_turn.flatten(2) @ part.flatten(2).mT for part in (turned.unsqueeze(1) @ turns, spins))
        return torch.cat([by_rotation, by_shift, by_spin, by_shift * line[:, None, None]], -1)

    def _rays(self, values: Values) -> Rays:
        return self.path.onward(self.held, values, self.passed) if self.passed else self.path.trace(self.observations.pixels, values)

    def _weighted(self, landed: Tensor) -> Tensor:
        return (self.weights @ (landed - self.observations.corners).unsqueeze(-1)).squeeze(-1)

    def _spread(self, by_probe: Tensor, rays: Rays, values: Values) -> Tensor:
        """(M, 2, 3) derivatives by the probes to those by every amplitude, (M, 2, n)."""
        outer = self.path.cover[-1]
        assert outer.relief
        _, adjusted = self.path.adjusted(self.observations.pixels, values)
        where = outer.surface.chart(outer.frame.enter(rays.origin.detach(), adjusted))
        return outer.relief.spread(by_probe, where)


def landings(
    path: Path, values: Values, observations: Observations, weights: Tensor, moving: Sequence[str], relief_moves: bool
) -> Iterator[Landing]:
    """The landings of all views, some views at a time, with the stages traced that stay as they are."""
    moves = {*moving, *(["relief.amplitudes"] if relief_moves else [])}
    still = 0
    for stage in path.stages:
        if moves & {param.name for param in stage.params} or (moves and path.adjustments):
            break
        still += 1
    for views in _runs(observations):
        some = observations.run(views)
        held = replace(path, cover=path.cover[: max(still - 1, 0)]).trace(some.pixels, some.told(values))
        first, last = (int(observations.starts[v]) for v in (views.start, views.stop))
        yield Landing(path, tuple(moving), relief_moves, some, held, still, weights[first:last])


def _runs(observations: Observations) -> Iterator[range]:
    """Consecutive views of about ROWS corners together."""
    starts = observations.starts.tolist()
    begin = 0
    for view, (_, end) in enumerate(pairwise(starts)):
        if view + 1 == len(starts) - 1 or end - starts[begin] >= ROWS:
            yield range(begin, view + 1)
            begin = view + 1


def joined(slopes: Sequence[Tensor]) -> Tensor:
    """(M, k, n) derivatives by all entries, from the (M, k, ...) of each number."""
    return torch.cat([by.flatten(2) if by.ndim > 2 else by.unsqueeze(-1) for by in slopes], -1)


def pixel_weights(path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float) -> Tensor:
    """(M, 2, 2) W that makes a residual on the board the reprojection error to first order, in standard deviations.

    e_px = -(d x_cb / d p)^-1 (x_cb(p) - x_true); sigma is px per axis, over each corner's own weight.
    """
    pixels = observations.pixels.detach().requires_grad_()
    with torch.enable_grad():
        landed, _ = path.land(pixels, observations.told(values), poses[observations.view])
        (slopes,) = by_row(landed, [pixels])
    weights: Tensor = torch.linalg.inv_ex(slopes).inverse * -(observations.weight / sigma)[:, None, None]
    return weights
