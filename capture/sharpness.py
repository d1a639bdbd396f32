"""The blur of a picture, measured on the board's own edges.

A blur widens every edge by its extent across that edge. Where two edges cross, the grey level gives
the blur's correlation between them: for the signs of two normal variables, the mean product is 2 /
pi * arcsin of their correlation. So the sides of the squares and their corners together determine
the blur's full covariance. An isotropic blur (focus, dirt) and a streak (motion while the shutter
was open) can thus be told apart, also where the streak runs along the diagonals of the squares.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board

# positions on a profile across an edge, in units of its reach
PROFILE_OFFSETS = np.linspace(-1, 1, 33)
SIDE_POSITIONS = np.linspace(0.3, 0.7, 7)  # positions on a side, over which profiles are averaged
REACH_FRACTION = 0.35  # fraction of the distance to the next edge
MAX_REACH = 12.0  # px: enough for a blur of 4 px
WINDOW = np.arange(-3, 3.5, 0.5)  # px, offsets from a corner
# px, sigma of the weights in the window: they tolerate a corner that is half a pixel off
WEIGHT = 1.0
SAMPLING = 1 / 6  # px^2, the variance that linear interpolation adds, on average over its phases


@dataclass(frozen=True, slots=True)
class Blur:
    """The blurred image of a point."""

    sigma: float
    """px, the standard deviation along the short axis: lens, focus and the pixel itself."""
    streak: float
    """px, the length of the straight motion that explains the long axis."""


def measure_blur(
    grey: NDArray[np.uint8], corners: NDArray[np.float64], board: Board
) -> Blur | None:
    """Return the blur around the (count, 2) px corners of a (H, W) picture; None if the board has
    no measurable edges.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    row_normal, row_variance = _sides(grey, grid)
    column_normal, column_variance = _sides(grey, grid.swapaxes(0, 1))
    widened = np.sqrt((row_variance + WEIGHT**2) * (column_variance + WEIGHT**2))
    covariance = _correlation(grey, grid) * widened - WEIGHT**2 * (column_normal @ row_normal)
    return blur_of(row_normal, row_variance, column_normal, column_variance, covariance)


def blur_of(
    row_normal: NDArray,
    row_variance: float,
    column_normal: NDArray,
    column_variance: float,
    covariance: float,
) -> Blur | None:
    """Return the blur from the (2,) unit normals of the board's two directions of edges, the
    variance in px^2 across each, and the covariance in px^2 between the two.
    """
    equations = np.stack(
        [
            _product(*pair)
            for pair in ((row_normal,) * 2, (column_normal,) * 2, (column_normal, row_normal))
        ]
    )
    moments = np.array([row_variance, column_variance, covariance])
    if not np.isfinite(moments).all() or abs(np.linalg.det(equations)) < 1e-3:
        return None
    xx, xy, yy = np.linalg.solve(equations, moments)
    mean, half = (xx + yy) / 2 - SAMPLING, np.hypot((xx - yy) / 2, xy)
    return Blur(float(np.sqrt(max(mean - half, 0.0))), float(np.sqrt(12 * 2 * half)))


def _sides(grey: NDArray, lines: NDArray) -> tuple[NDArray[np.float64], float]:
    """Return the mean (2,) unit normal, towards the next line, and the variance in px^2 across the
    sides of the squares that lie on (lines, corners, 2) px.
    """
    ends = lines[:, :-1], lines[:, 1:]
    side = ends[1] - ends[0]
    normal = np.stack([-side[..., 1], side[..., 0]], -1) / np.linalg.norm(
        side, axis=-1, keepdims=True
    )
    spacing = np.gradient(lines, axis=0)
    spacing = (
        spacing[:, :-1] + spacing[:, 1:]
    ) / 2  # along the other lines: a step across the edge would leave a slanted square
    height = (spacing * normal).sum(-1)  # (lines, sides), signed
    normal, height = normal * np.sign(height)[..., None], np.abs(height)
    reach = np.minimum(REACH_FRACTION * height, MAX_REACH)
    middles = (
        ends[0][:, :, None] + SIDE_POSITIONS[:, None] * side[:, :, None]
    )  # (lines, sides, along, 2)
    steps = (
        PROFILE_OFFSETS[:, None] * ((reach / height)[..., None] * spacing)[:, :, None]
    )  # (lines, sides, across, 2)
    places = middles[..., None, :] + steps[:, :, None]
    profile = sample_grey(grey, places).mean(2)
    first = profile[..., :4].mean(-1)
    last = profile[..., -4:].mean(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        white_fraction = (profile - first[..., None]) / (last - first)[..., None]
    overlap = (
        (white_fraction * (1 - white_fraction)).sum(-1)
        * reach
        * (PROFILE_OFFSETS[1] - PROFILE_OFFSETS[0])
    )  # sigma / sqrt pi for a normal blur
    return normal.mean((0, 1)) / np.linalg.norm(normal.mean((0, 1))), float(
        np.pi * np.median(overlap) ** 2
    )


def _correlation(grey: NDArray, grid: NDArray) -> float:
    """Return the correlation between the blur across columns and the blur across rows, from the
    grey levels where they cross, weighted over a small window.
    """
    square = sample_grey(grey, (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:]) / 4)
    diagonal = (square[:-1, :-1] + square[1:, 1:]) / 2
    antidiagonal = (square[:-1, 1:] + square[1:, :-1]) / 2
    light = light_at(grey, grid[1:-1, 1:-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        product = (2 * light - diagonal - antidiagonal) / (diagonal - antidiagonal)
    return float(np.sin(np.pi / 2 * np.clip(np.median(product), -1, 1)))


def light_at(grey: NDArray, corners: NDArray) -> NDArray[np.float64]:
    """Return the (...) grey levels at the (..., 2) px corners, each a weighted mean over a small
    window.
    """
    offsets = np.stack(np.meshgrid(WINDOW, WINDOW), -1).reshape(-1, 2)
    weights = np.exp(-(offsets**2).sum(-1) / (2 * WEIGHT**2))
    return np.asarray(sample_grey(grey, corners[..., None, :] + offsets) @ weights / weights.sum())


def _product(u: NDArray, v: NDArray) -> NDArray[np.float64]:
    """Return the (3,) weights of a covariance's xx, xy, yy in u @ covariance @ v."""
    return np.array([u[0] * v[0], u[0] * v[1] + u[1] * v[0], u[1] * v[1]])


def sample_grey(grey: NDArray, places: NDArray) -> NDArray[np.float64]:
    """Return the (...) brightness at (..., 2) px."""
    flat = places.reshape(len(places), -1, 2).astype(np.float32)
    return np.asarray(
        cv2.remap(
            grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float64,
    ).reshape(places.shape[:-1])
