"""How a picture smears the board's own edges, whatever else is in it.

A blur widens every edge by its extent across that edge; where two edges cross, it leaves a grey
that tells the blur's correlation between them (of signs of two normal variables, the mean product
is 2 / pi * arcsin of their correlation). So the sides of the squares and their corners together
give its whole covariance, and an even blur (focus, dirt) and a streak (motion while the shutter was
open) can be told apart, also where the streak runs along the diagonals of the squares.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board

ACROSS = np.linspace(-1, 1, 33)  # places on a profile across an edge, in reaches
ALONG = np.linspace(0.3, 0.7, 7)  # places on a side, over which profiles are averaged
REACH = 0.35  # of the way to the next edge
FARTHEST = 12.0  # px: enough for a blur of 4 px
WINDOW = np.arange(-3, 3.5, 0.5)  # px, about a corner
WEIGHT = 1.0  # px, sigma of the weights in it: they forgive a corner that is half a pixel off
SAMPLING = 1 / 6  # px^2, what linear interpolation adds to a variance, on average over its phases


@dataclass(frozen=True, slots=True)
class Blur:
    """What becomes of a point."""

    sigma: float
    """px, standard deviation along its short axis: lens, focus and the pixel itself."""
    streak: float
    """px, length of the motion in a straight line that would explain its long axis."""


def measure_blur(
    grey: NDArray[np.uint8], corners: NDArray[np.float64], board: Board
) -> Blur | None:
    """Around the (count, 2) px corners of a (H, W) picture; None where the board has no edges to
    speak of.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    row_normal, row_variance = _sides(grey, grid)
    column_normal, column_variance = _sides(grey, grid.swapaxes(0, 1))
    widened = np.sqrt((row_variance + WEIGHT**2) * (column_variance + WEIGHT**2))
    between = _correlation(grey, grid) * widened - WEIGHT**2 * (column_normal @ row_normal)
    return blur_of(row_normal, row_variance, column_normal, column_variance, between)


def blur_of(
    row_normal: NDArray,
    row_variance: float,
    column_normal: NDArray,
    column_variance: float,
    between: float,
) -> Blur | None:
    """From (2,) unit normals of a board's two directions of edges, px^2 across each, and px^2
    between the two.
    """
    equations = np.stack(
        [
            _product(*pair)
            for pair in ((row_normal,) * 2, (column_normal,) * 2, (column_normal, row_normal))
        ]
    )
    known = np.array([row_variance, column_variance, between])
    if not np.isfinite(known).all() or abs(np.linalg.det(equations)) < 1e-3:
        return None
    xx, xy, yy = np.linalg.solve(equations, known)
    middle, half = (xx + yy) / 2 - SAMPLING, np.hypot((xx - yy) / 2, xy)
    return Blur(float(np.sqrt(max(middle - half, 0.0))), float(np.sqrt(12 * 2 * half)))


def _sides(grey: NDArray, lines: NDArray) -> tuple[NDArray[np.float64], float]:
    """Of the sides of squares that lie on (lines, corners, 2) px: the mean (2,) unit normal,
    towards the next line, and px^2 across.
    """
    ends = lines[:, :-1], lines[:, 1:]
    side = ends[1] - ends[0]
    normal = np.stack([-side[..., 1], side[..., 0]], -1) / np.linalg.norm(
        side, axis=-1, keepdims=True
    )
    onward = np.gradient(lines, axis=0)
    onward = (
        onward[:, :-1] + onward[:, 1:]
    ) / 2  # along the other lines: across the edge it would leave a slanted square
    height = (onward * normal).sum(-1)  # (lines, sides), signed
    normal, height = normal * np.sign(height)[..., None], np.abs(height)
    reach = np.minimum(REACH * height, FARTHEST)
    middles = ends[0][:, :, None] + ALONG[:, None] * side[:, :, None]  # (lines, sides, along, 2)
    steps = (
        ACROSS[:, None] * ((reach / height)[..., None] * onward)[:, :, None]
    )  # (lines, sides, across, 2)
    places = middles[..., None, :] + steps[:, :, None]
    profile = sampled(grey, places).mean(2)
    first, last = profile[..., :4].mean(-1), profile[..., -4:].mean(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (profile - first[..., None]) / (last - first)[..., None]
    overlap = (
        (part * (1 - part)).sum(-1) * reach * (ACROSS[1] - ACROSS[0])
    )  # sigma / sqrt pi for a normal blur
    return normal.mean((0, 1)) / np.linalg.norm(normal.mean((0, 1))), float(
        np.pi * np.median(overlap) ** 2
    )


def _correlation(grey: NDArray, grid: NDArray) -> float:
    """Between the blur across columns and the blur across rows, from the grey where they cross,
    weighted over a small window.
    """
    square = sampled(grey, (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:]) / 4)
    same, other = (square[:-1, :-1] + square[1:, 1:]) / 2, (square[:-1, 1:] + square[1:, :-1]) / 2
    light = light_at(grey, grid[1:-1, 1:-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        product = (2 * light - same - other) / (same - other)
    return float(np.sin(np.pi / 2 * np.clip(np.median(product), -1, 1)))


def light_at(grey: NDArray, corners: NDArray) -> NDArray[np.float64]:
    """(...) grey levels where edges cross, in the weighted mean over a small window, of (..., 2)
    px.
    """
    offsets = np.stack(np.meshgrid(WINDOW, WINDOW), -1).reshape(-1, 2)
    weights = np.exp(-(offsets**2).sum(-1) / (2 * WEIGHT**2))
    return np.asarray(sampled(grey, corners[..., None, :] + offsets) @ weights / weights.sum())


def _product(one: NDArray, other: NDArray) -> NDArray[np.float64]:
    """(3,) the weights of a covariance's xx, xy, yy in one @ covariance @ other."""
    return np.array([one[0] * other[0], one[0] * other[1] + one[1] * other[0], one[1] * other[1]])


def sampled(grey: NDArray, places: NDArray) -> NDArray[np.float64]:
    """(...) brightness at (..., 2) px."""
    flat = places.reshape(len(places), -1, 2).astype(np.float32)
    return np.asarray(
        cv2.remap(
            grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float64,
    ).reshape(places.shape[:-1])
