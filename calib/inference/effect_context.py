"""The context from which effects are proposed, and the place of a possible bump on the glass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import EffectContext, PlaceOnGlass
from calib.estimation.objective import HUBER
from calib.estimation.orthogonal_projection import orthonormal_basis
from calib.estimation.residual_blocks import pixel_weights
from calib.inference.fitted_model import FittedModel
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.placement import Placement
from calib.optics.relief import AMPLITUDES, PROBES, Relief
from calib.session.board import Board
from calib.session.camera import Camera

BUMP_WIDTHS = (4e-4, 8e-4, 1.6e-3)
"""m: the widths of the bumps that are tried: drops and dust. What is wider is a relief."""
MAX_PLACES = 2000
"""The largest number of places that are tried: where the rays of some corners leave the glass."""
AROUND = np.stack(np.meshgrid(*[np.arange(-2.0, 3.0)] * 2), -1).reshape(-1, 2)
"""(25, 2) steps to places around one of them."""
MOST_REFINED = 20
"""The number of these places around which others are tried."""
MAX_CELLS = 2_000_000
"""The largest number of corners times places that are in memory together: 0.1 GB."""
MIN_SIZE = 1e-3
"""The smallest shift of the corners by a bump, over the largest of all: smaller ones show nothing.
"""
EVEN = Relief((-1.0, -1.0), (1.0, 1.0), (2, 2))
"""A relief without amplitudes, for glass that has none: it takes the probes."""
NEXT_CORNERS = 12
"""The number of corners that tell a point on the glass next to them."""

Array = NDArray[np.float64]


def place_of_bump(fitted: FittedModel) -> PlaceOnGlass | None:
    """Return the place on the outer surface, and the width, with which a bump explains the residual
    best, to first order, beside all parameters of the fit; None without a cover.
    """
    path, joint, observations = fitted.model.path, fitted.joint, fitted.observations
    if not path.cover:
        return None
    outer = path.cover[-1]
    rays = path.trace(observations.pixels, joint.values, observations.exposure)
    points = outer.frame.at(_adjusted(fitted)).enter(rays.origin)
    zero, one = torch.zeros_like(points.x), torch.ones_like(points.x)
    slopes = [outer.surface.chart_gradient(points, *units) for units in ((one, zero), (zero, one))]
    metres = (1 / torch.stack([slope.stacked().norm(dim=-1) for slope in slopes], -1)).numpy()
    chart = torch.stack(outer.surface.chart(points), -1).numpy()
    scores = _BumpScores.of(fitted, chart)
    seen = np.flatnonzero((rays.failure == 0).numpy())
    rows = seen[:: len(seen) // MAX_PLACES + 1]
    best, found = 0.0, None
    for width in BUMP_WIDTHS:
        chi2 = scores.chi2(chart[rows], metres[rows], width)
        chosen = rows[chi2.argsort(kind="stable")[-MOST_REFINED:]]
        places, scales = chart[chosen], metres[chosen]
        for step in (width / 2, width / 4):
            scales = scales.repeat(len(AROUND), 0)
            places = (
                places.repeat(len(AROUND), 0) + step * np.tile(AROUND, (len(places), 1)) / scales
            )
            chi2 = scores.chi2(places, scales, width)
            index = int(chi2.argmax())
            places, scales = places[[index]], scales[[index]]
        if chi2[index] > best:
            best = float(chi2[index])
            (first, second), (first_m, second_m) = places[0].tolist(), scales[0].tolist()
            found = PlaceOnGlass((first, second), (first_m, second_m), width)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _BumpScores:
    """The scores of bumps on the outer surface."""

    chart: Array
    """(M, 2) chart coordinates where the corners' rays leave the glass."""
    by_probe: Array
    """(M, 2, 3) `_by_probe`."""
    residual: Array
    """(2M,) what the views' own parameters leave."""
    bases: Sequence[Array]
    """Of each view: an orthonormal basis of what its own parameters do."""
    ends: NDArray[np.int64]
    """(V + 1,) the ends of the views' rows."""
    whitened: Array
    """(S, 2M) what the shared parameters do beside them."""

    @staticmethod
    def of(fitted: FittedModel, chart: Array) -> _BumpScores:
        views = list(fitted.equations())
        reduced = [view.reduce() for view in views]
        shared = np.concatenate([view.jacobian for view in reduced])
        information = shared.T @ shared + fitted.prior_precision()
        return _BumpScores(
            chart=chart,
            by_probe=_by_probe(fitted),
            residual=np.concatenate([view.residual for view in reduced]),
            bases=[orthonormal_basis(view.jacobian_block) for view in views],
            ends=2 * fitted.observations.starts.numpy(),
            whitened=np.linalg.solve(np.linalg.cholesky(information), shared.T),
        )

    def chi2(self, places: Array, metres: Array, width: float) -> Array:
        """Return (K,) by how much bumps of this width at (K, 2) chart coordinates lower the sum of
        squares, with (K, 2) m per unit there.
        """
        step = MAX_CELLS // len(self.chart) + 1
        parts = [
            self._scores(places[first : first + step], metres[first : first + step], width)
            for first in range(0, len(places), step)
        ]
        score, size = np.concatenate(parts, 1)
        visible = size > MIN_SIZE * size.max()
        return np.where(visible, score**2 / np.where(visible, size, 1.0), 0.0)

    def _scores(self, places: Array, metres: Array, width: float) -> Array:
        """Return (2, K) the scores of the heights of bumps, and the information about them."""
        offset = (self.chart[:, None] - places) * metres  # (M, K, 2) m
        first, second = np.moveaxis(offset, -1, 0)
        fall = np.exp((first**2 + second**2) / (-2 * width**2))
        first *= metres[:, 0] / -(width**2)
        second *= metres[:, 1] / -(width**2)
        height, by_first, by_second = np.moveaxis(self.by_probe, -1, 0)[..., None]  # (M, 2, 1)
        column = height + by_first * first[:, None] + by_second * second[:, None]
        column = (column * fall[:, None]).reshape(-1, len(places))
        parts = zip(self.bases, pairwise(self.ends), strict=True)
        by_pose = sum(((basis.T @ column[a:b]) ** 2).sum(0) for basis, (a, b) in parts)
        by_shared = ((self.whitened @ column) ** 2).sum(0)
        return np.stack([self.residual @ column, (column**2).sum(0) - by_pose - by_shared])


def _by_probe(fitted: FittedModel) -> Array:
    """Return the (M, 2, 3) derivatives of the corners' residuals, px over sigma, by the height of
    the outer surface and its two slopes where each ray leaves it, with the weights of a robust fit
    (`calib.estimation.objective`); 0 for a ray that fails.
    """
    path, joint, observations = fitted.model.path, fitted.joint, fitted.observations
    poses = joint.poses[observations.view]
    weights = pixel_weights(path, joint.values, observations, joint.poses, joint.sigma)
    path, values = with_any_relief(path, joint.values)
    trace = path.trace_with_derivatives(
        observations.pixels,
        path.values_of_views(values, poses),
        observations.exposure,
        frozenset({AMPLITUDES}),
    )
    boards = Placement.of(poses).at_exposure(observations.exposure)
    corners, planes = path.planes(observations.corners, boards)
    landed, failure, landing = path.target.land(trace.rays, planes, joint.values)
    residual = (weights @ (landed - corners).unsqueeze(-1)).squeeze(-1)
    by = trace.pull(landing.pull(weights.transpose(0, 1))[0])
    derivatives = torch.stack([by[name] for name in PROBES], -1).transpose(0, 1)
    size = residual.norm(dim=-1).clamp_min(HUBER)
    robust = torch.where(failure == 0, (HUBER / size).sqrt(), 0.0)
    return np.asarray((robust[:, None, None] * derivatives).numpy())


def with_any_relief(path: Path, values: Values) -> tuple[Path, Values]:
    """Return the path and its values with a relief, which is flat where there was none."""
    if path.relief:
        return path, values
    *inner, outer = path.cover
    path = replace(path, cover=(*inner, replace(outer, relief=EVEN)))
    return path, {**values, AMPLITUDES: torch.zeros(EVEN.grid, dtype=torch.float64)}


def _adjusted(fitted: FittedModel) -> Values:
    """Return the values as the stages read them."""
    observations = fitted.observations
    path, values = fitted.model.path, fitted.joint.values
    return path.adjust_pixels(observations.pixels, values, observations.exposure)[1]


def point_on_glass(fitted: FittedModel, chart: Tensor) -> Tensor:
    """Return the (3,) m point in the camera frame at (2,) chart coordinates of the outer surface,
    from the rays of the corners next to it.
    """
    path, values, observations = fitted.model.path, fitted.joint.values, fitted.observations
    outer = path.cover[-1]
    rays = path.trace(observations.pixels, values, observations.exposure)
    surface = outer.surface.chart(outer.frame.at(_adjusted(fitted)).enter(rays.origin))
    offset = torch.stack(surface, -1) - chart
    span = offset.abs().nan_to_num().amax(0).clamp_min(1e-300)
    distance = torch.where(rays.failure == 0, (offset / span).norm(dim=-1), torch.inf)
    nearest = distance.argsort(stable=True)[:NEXT_CORNERS]
    plane = torch.column_stack([torch.ones(len(nearest)), offset[nearest] / span])
    solution: Tensor = torch.linalg.lstsq(plane, rays.origin.stacked()[nearest]).solution
    return solution[0]


def effect_context(
    fitted: FittedModel, board: Board, camera: Camera, *, locate: bool
) -> EffectContext:
    """Return the context of a fit for proposing effects; with `locate`, it includes the place of a
    finer relief, which takes a while.
    """
    return EffectContext(
        board,
        camera.width,
        camera.height,
        fitted.model.path,
        fitted.joint.values,
        frozenset(fitted.model.priors.sigmas),
        camera.shutter,
        place_of_bump(fitted) if locate else None,
    )
