"""Leave out single corners that a detector put at a wrong place.

Such a corner is pixels away from where its neighbours on the board show it. What a model lacks is
smooth over the board, or belongs to a place of the picture or of the board: it moves neighbouring
corners, the corners of other views at the same place of the picture, or the same corner in many
views. These corners stay in the fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.estimation.noise import MIN_NOISE, on_board_grid
from calib.estimation.residuals import Residuals
from calib.estimation.robust import SIGMA
from calib.io.numerals import counted
from calib.session.board import Board
from calib.session.camera import Camera

Floats = NDArray[np.float64]

MIN_DEVIATION = 10.0
"""Robust standard deviations of all deviations: a corner that deviates less is no outlier. On
measured sets 0 to 0.4 % of the corners deviate by more.
"""
MAX_TYPICAL_DEVIATION = 3.0
"""Robust standard deviations: if the median of other views' corners at the same place of the
picture, or of the same corner of the board, deviates by more, the place is the cause. Noise alone
gives 1.2.
"""
MAX_NEIGHBOUR_DEVIATION = 5.0
"""Robust standard deviations: if a neighbour on the board deviates by more once the corner is
removed, the two may have one cause, such as a drop on the glass.
"""
NEAR = 0.025
"""The radius of a place of the picture, as a fraction of its diagonal."""
MAX_NEAR = 4
"""The largest number of corners of other views that show what a place does. Without any, a corner
may be an outlier: one view alone proves no drop on the glass.
"""
MIN_PREDICTIONS = 2
"""The number of lines of the board that must show where a corner belongs."""
MAX_FRACTION = 0.1
"""The largest fraction of all corners that is left out. If more deviate, it is no accident."""
MAX_FRACTION_OF_VIEW = 0.2
"""The largest fraction of a view's corners that is left out. If more deviate, the whole view is
wrong.
"""
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""The lines of a board through a corner, as steps of rows and columns."""


def find_outlier_corners(
    views: Sequence[View], residual: Residuals, board: Board, camera: Camera
) -> NDArray[np.bool_]:
    """Return (V, N) true for the outliers among the corners of a fit.

    Args:
        views: the views of the fit.
        residual: the residuals of their visible corners.
    """
    if not board.has_grid:
        return np.zeros((len(views), board.count), dtype=bool)
    weights = np.array([view.weight for view in views])
    grid = on_board_grid(residual.image, views) * weights[..., None]
    deviation = _deviations(grid.reshape(-1, board.rows, board.columns, 2))
    # An outlier makes its neighbours deviate as well.
    candidates = deviation > np.maximum(MIN_DEVIATION, _largest_of_neighbours(deviation))
    without = np.where(candidates[..., None], np.nan, grid.reshape(*candidates.shape, 2))
    candidates &= _largest_of_neighbours(_deviations(without)) < MAX_NEIGHBOUR_DEVIATION
    candidates = candidates.reshape(len(views), -1)
    deviation = deviation.reshape(len(views), -1)
    plausible = _plausible(candidates, deviation, weights > 0)
    pixels = np.array([view.corners for view in views])
    radius = NEAR * float(np.hypot(camera.width, camera.height))
    return plausible & ~_at_bad_places(plausible, deviation, pixels, radius)


def without_corners(views: Sequence[View], masks: NDArray[np.bool_]) -> tuple[View, ...]:
    """Return the views without the corners whose (V, N) masks are true."""
    return tuple(
        replace(
            view,
            corners=np.where(mask[:, None], np.nan, view.corners),
            weight=np.where(mask, 0.0, view.weight),
        )
        if mask.any()
        else view
        for view, mask in zip(views, masks, strict=True)
    )


def describe_outlier_corners(counts: Mapping[str, int] | None) -> str:
    """Return one sentence about outlier corners, from their number in each view; empty if there are
    none.
    """
    if not counts:
        return ""
    total = sum(counts.values())
    verb = "is" if total == 1 else "are"
    return (
        f"{counted(total, 'corner')} of {counted(len(counts), 'view')} {verb} pixels away from"
        f" where neighbouring corners show {'it' if total == 1 else 'them'}, and left out."
    )


def _deviations(grid: Floats) -> Floats:
    """Return the (V, rows, columns) distances of residuals from what their neighbours on the board
    predict, over their robust standard deviation in all views or in their view, whichever is
    larger. They are 0 for corners without enough neighbours.

    Args:
        grid: (V, rows, columns, 2) residuals, NaN where a corner is not visible.
    """
    rows, columns = grid.shape[1:3]
    padded = np.pad(grid, ((0, 0), (2, 2), (2, 2), (0, 0)), constant_values=np.nan)

    def at(row_step: int, column_step: int) -> Floats:
        return padded[
            :, 2 + row_step : 2 + row_step + rows, 2 + column_step : 2 + column_step + columns
        ]

    predictions = []
    for row_step, column_step in DIRECTIONS:
        forward, back = at(row_step, column_step), at(-row_step, -column_step)
        from_forward = 2 * forward - at(2 * row_step, 2 * column_step)
        from_back = 2 * back - at(-2 * row_step, -2 * column_step)
        extrapolated = np.where(np.isfinite(from_forward), from_forward, from_back)
        between = (forward + back) / 2
        predictions.append(np.where(np.isfinite(between), between, extrapolated))
    predicted = np.stack(predictions)
    usable = np.isfinite(predicted[..., 0]).sum(0) >= MIN_PREDICTIONS
    usable &= np.isfinite(grid[..., 0])
    differences = np.full(grid.shape, np.nan)
    differences[usable] = grid[usable] - np.nanmedian(predicted[:, usable], axis=0)
    if not usable.any():
        return np.zeros(grid.shape[:3])
    scale = max(SIGMA * float(np.nanmedian(np.abs(differences))), MIN_NOISE)
    scales = [
        max(scale, SIGMA * float(np.nanmedian(np.abs(view)))) if mask.any() else scale
        for view, mask in zip(differences, usable, strict=True)
    ]
    size = np.linalg.norm(differences, axis=-1)
    return np.where(usable & (size > 0), size / np.reshape(scales, (-1, 1, 1)), 0.0)


def _largest_of_neighbours(deviation: Floats) -> Floats:
    """Return the (V, rows, columns) largest deviation among the eight neighbours on the board."""
    rows, columns = deviation.shape[1:]
    padded = np.pad(deviation, ((0, 0), (1, 1), (1, 1)))
    neighbours = [
        padded[:, row : row + rows, column : column + columns]
        for row in range(3)
        for column in range(3)
        if (row, column) != (1, 1)
    ]
    return np.asarray(np.max(neighbours, axis=0))


def _plausible(
    candidates: NDArray[np.bool_], deviation: Floats, visible: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the (V, N) candidates without those of views that have too many, and of corners of the
    board that deviate in most views; none if there are too many in all.

    Args:
        deviation: (V, N) as `_deviations` returns them; 0 is unknown.
    """
    in_view = candidates.sum(1) <= MAX_FRACTION_OF_VIEW * visible.sum(1)
    of_board = [
        bool((column > 0).any() and np.median(column[column > 0]) > MAX_TYPICAL_DEVIATION)
        for column in deviation.T
    ]
    plausible = candidates & in_view[:, None] & ~np.array(of_board)
    return np.asarray(plausible & (candidates.sum() <= MAX_FRACTION * visible.sum()))


def _at_bad_places(
    candidates: NDArray[np.bool_], deviation: Floats, pixels: Floats, radius: float
) -> NDArray[np.bool_]:
    """Return the (V, N) mask of candidates at whose place of the picture the corners of other views
    deviate as well.

    Args:
        deviation: (V, N) as `_deviations` returns them; 0 is unknown.
        pixels: (V, N, 2) px.
        radius: the radius of a place, px.
    """
    mask = np.zeros_like(candidates)
    for view, corner in np.argwhere(candidates):
        distance = np.linalg.norm(pixels - pixels[view, corner], axis=-1)
        distance[view] = np.inf
        distance[~(deviation > 0)] = np.inf
        nearest = np.argsort(distance, axis=None)[:MAX_NEAR]
        near = nearest[distance.ravel()[nearest] <= radius]
        if len(near):
            mask[view, corner] = np.median(deviation.ravel()[near]) > MAX_TYPICAL_DEVIATION
    return mask
