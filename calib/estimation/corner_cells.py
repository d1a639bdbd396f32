"""Sessions of very many corners: a part of the corners, and averages of neighbouring ones.

What a fit estimates is smooth over a board: its pose, its bend, the lens, the glass. So a fit may
start with a few corners of each view, spread evenly over the board, and a question about a finished
fit may be asked of averages. The members of one cell of the board become one corner at their mean
place, whose error is their mean error. Nothing is fitted to the corners for that, so a curved
lattice of corners costs nothing: the error is that about the model. An average weighs as much as
all of its members, and tells as much of whatever hardly changes within a cell. k cells along each
side lose 1 / k^2 of what is linear over the board.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from calib.estimation.objective import HUBER
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.optics.exposure import Exposure
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project

CELLS = 20_000
"""The cells of all views together: as many as 250 views of 81 corners have corners."""
MIN_SIDE = 4
"""The cells along each side of a board, at least: four by four points tell a pose and a bend."""
MIN_MEMBERS = 2.0
"""The corners for each cell, below which all corners are used."""


def is_large(observations: Observations) -> bool:
    """True if there are so many corners that a part or averages of them take less than half of the
    time.
    """
    views = max(1, len(observations.names))
    return len(observations.pixels) > MIN_MEMBERS * views * _side(observations) ** 2


def spread_part(observations: Observations) -> Observations:
    """Return one corner of each cell, the one nearest to its middle; all corners of a session that
    is not large.
    """
    return (
        observations.select_rows(part_rows(observations))
        if is_large(observations)
        else observations
    )


def part_rows(observations: Observations) -> Tensor:
    """Return (M,) true for the corners of `spread_part`."""
    rows = torch.ones(len(observations.pixels), dtype=torch.bool)
    if not is_large(observations):
        return rows
    cell, distance = _cells(observations)
    order = torch.from_numpy(np.lexsort((distance.numpy(), cell.numpy())))
    repeated = cell[order][1:] == cell[order][:-1]
    rows[order[1:][repeated]] = False
    return rows


def average_corners(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    sigma: float,
    image: Tensor | None = None,
) -> Observations:
    """Return the averages of the corners of each cell; the corners themselves if the session is not
    large.

    A corner counts by its weight squared, and less beyond Huber's limit, as in a fit. The weights
    of averages exceed 1.

    Args:
        path: the path of a fit.
        values: its values.
        poses: (V, B) its view parameters.
        sigma: px, its noise.
        image: (M, 2) px, its reprojection errors (`Residuals`); None to compute them.
    """
    if not is_large(observations):
        return observations
    if image is None:
        image = residuals(path, values, observations, poses).image
    cell, _ = _cells(observations)
    visible = torch.isfinite(image).all(-1)
    error = torch.where(visible[:, None], image, 0.0)
    size = error.norm(dim=-1) * observations.weight / sigma
    weight = observations.weight**2 * (HUBER / size).clamp_max(1.0) * visible
    numbers, member = torch.unique(cell, return_inverse=True)  # in the order of the views

    def total(of_rows: Tensor) -> Tensor:
        return of_rows.new_zeros(len(numbers), *of_rows.shape[1:]).index_add(0, member, of_rows)

    def mean(of_rows: Tensor) -> Tensor:
        columns = of_rows.flatten(1) if of_rows.ndim > 1 else of_rows[:, None]
        return (total(weight[:, None] * columns) / weights[:, None]).reshape(-1, *of_rows.shape[1:])

    weights = total(weight)
    mean_error = mean(error)
    squares = float((weight * ((error - mean_error[member]) ** 2).sum(-1)).sum())
    views = len(observations.names)
    view = numbers // _side(observations) ** 2
    exposure = observations.exposure
    averages = Observations(
        names=observations.names,
        pixels=mean(observations.pixels),
        corners=mean(observations.corners),
        weight=weights.sqrt(),
        starts=torch.cat([view.new_zeros(1), torch.bincount(view, minlength=views).cumsum(0)]),
        exposure=exposure
        and Exposure(
            mean(exposure.time), mean(exposure.line), None if exposure.view is None else view
        ),
        whitening=None if observations.whitening is None else mean(observations.whitening),
    ).select_rows(weights > 0)
    projected = torch.cat([_project(path, values, b, poses) for b in averages.batches()])
    averages = replace(averages, pixels=projected - mean_error[weights > 0])
    averages = averages.select_rows(torch.isfinite(projected).all(-1))
    merged = int(visible.sum()) - len(averages.pixels)
    return replace(averages, merged=merged, merged_squares=squares)


def _project(path: Path, values: Values, observations: Observations, poses: Tensor) -> Tensor:
    """Return the (M, 2) px at which a model images the corners of few observations."""
    of_rows, exposure = poses[observations.view], observations.exposure
    values = path.values_of_views(values, of_rows)
    rays = path.trace(observations.pixels, values, exposure) if path.target.glass else None
    points = path.place(observations.corners, values, of_rows, exposure, rays)
    return project(path, values, points, exposure, start=observations.pixels)


def _side(observations: Observations) -> int:
    """The number of cells along each side of a board."""
    return max(MIN_SIDE, math.isqrt(CELLS // max(1, len(observations.names))))


def _cells(observations: Observations) -> tuple[Tensor, Tensor]:
    """Return the (M,) int64 cell of each corner, in the order of the views, and its (M,) distance
    from the middle of its cell, in cells. The cells of a view cover its visible corners.
    """
    side = _side(observations)
    places, view = observations.corners[:, :2], observations.view
    of_views = places.new_zeros(len(observations.names), 2)
    at_view = view[:, None].expand_as(places)
    low = of_views.scatter_reduce(0, at_view, places, "amin", include_self=False)[view]
    high = of_views.scatter_reduce(0, at_view, places, "amax", include_self=False)[view]
    at = (places - low) / (high - low).clamp_min(1e-12) * side
    index = at.floor().clamp(0, side - 1)
    cell = (view * side + index[:, 1].long()) * side + index[:, 0].long()
    return cell, (at - index - 0.5).norm(dim=-1)
