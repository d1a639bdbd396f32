"""Pictures of a board whose corners are known, and how well any estimator could find them.

Nothing of `calib.corners` is in here. Every subpixel gets the part of its area that is white, through a pinhole that looks at a tilted
board; a Gaussian blurs that, the pixel's square gathers it, and light, noise, sharpening, rounding and a JPEG follow.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from calib.session.board import Board

FINE = 4  # subpixels per pixel and axis
BLACK, WHITE = 0.125, 1.0  # of the brightest white

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scene:
    """A board, and what the camera makes of it."""

    square: float = 40.0
    """px, of a square at the board's middle, before it is tilted."""
    tilt: float = 30.0
    """Degrees."""
    blur: float = 0.7
    """px, standard deviation, the pixel's own square not in it."""
    noise: float = 1.5
    """Grey levels."""
    contrast: float = 175.0
    """Grey levels, from black to white."""
    uneven: float = 0.0
    """How much brighter the light is at one end of the board than in its middle, as a part."""
    sharpening: float = 0.0
    """The part of what a blur of 1 px removes that is added, after the noise."""
    jpeg: int = 0
    """Quality; 0: none."""
    board: Board = Board(7, 6, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A picture of a scene."""

    picture: NDArray[np.uint8]
    """(H, W)"""
    corners: Floats
    """(count, 2) px"""
    bounds: Floats
    """(count, 2, 2) px^2, the Cramer-Rao bound of each corner's place, from the pixels that are nearer to it than to another."""


def draw(scene: Scene, rng: np.random.Generator) -> Drawn:
    """Turned, tilted about an axis, and placed within a pixel, all at random."""
    board = scene.board
    margin = 1.5
    distance = 3.0 * max(board.columns, board.rows)  # squares
    rotation = _turn(rng.uniform(-np.pi, np.pi), scene.tilt) @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-np.pi, np.pi)]))[0]
    half = np.array([board.columns + margin, board.rows + margin]) / 2
    rim = np.array([[x, y] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    focal = scene.square * distance
    in_view = np.column_stack([rotation[:, :2], (0, 0, distance)])
    ends = _projected(np.diag([focal, focal, 1.0]) @ in_view, rim)
    centre = -ends.min(0) + 2 + rng.random(2)
    width, height = np.ceil(ends.max(0) + centre).astype(int) + 3
    px_from_squares = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]]) @ in_view
    grid = board.points() / board.square
    corners = _projected(px_from_squares, grid)

    light = scene.contrast / (WHITE - BLACK) * _light(scene, px_from_squares, (width, height))
    noisy = light + rng.normal(0, scene.noise, light.shape)
    sharp = noisy + scene.sharpening * (noisy - gaussian_filter(noisy, 1.0))
    picture = np.clip(np.rint(sharp), 0, 255).astype(np.uint8)
    if scene.jpeg:
        picture = np.asarray(cv2.imdecode(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])[1], cv2.IMREAD_GRAYSCALE))
    variance = scene.noise**2 + 1 / 12
    return Drawn(picture, corners, variance * np.linalg.inv(_information(light, px_from_squares, grid)))


def _turn(azimuth: float, tilt: float) -> Floats:
    return np.asarray(cv2.Rodrigues(np.deg2rad(tilt) * np.array([np.cos(azimuth), np.sin(azimuth), 0]))[0])


def _projected(mapping: Floats, points: Floats) -> Floats:
    """(N, 2) of (N, 2), by a (3, 3) homography."""
    ahead = np.column_stack([points, np.ones(len(points))]) @ mapping.T
    return np.asarray(ahead[:, :2] / ahead[:, 2:])


def _light(scene: Scene, px_from_squares: Floats, size: tuple[int, int]) -> Floats:
    """(H, W), 1 for white; no noise."""
    width, height = size
    x, y = ((np.arange(extent * FINE) + 0.5) / FINE - 0.5 for extent in (width, height))
    squares_from_px = np.linalg.inv(px_from_squares)
    pixels = np.stack(np.broadcast_arrays(x[None], y[:, None], np.ones(())), -1)
    ahead = pixels @ squares_from_px.T
    board = ahead[..., :2] / ahead[..., 2:]
    # squares per subpixel along x and y: how wide a subpixel is across an edge
    by_x, by_y = ((squares_from_px[:2, axis] - board * squares_from_px[2, axis]) / ahead[..., 2:] / FINE for axis in (0, 1))
    wide = np.abs(by_x) + np.abs(by_y)
    offset = np.array([scene.board.columns - 1, scene.board.rows - 1]) / 2
    place = board + offset  # corners are at whole numbers
    nearest = np.rint(place)
    part = np.clip((place - nearest) / wide * 2, -1, 1)  # from -1 to 1 over the subpixel that an edge crosses
    sign = np.where(np.abs(nearest).astype(int).sum(-1) % 2, -1.0, 1.0)
    white = (1 + sign * part[..., 0] * part[..., 1]) / 2
    outside = ((place < -1) | (place > [scene.board.columns, scene.board.rows])).any(-1)
    reflected = np.where(outside, WHITE, BLACK + (WHITE - BLACK) * white)
    blurred = gaussian_filter(reflected, scene.blur * FINE, mode="nearest")
    gathered = blurred.reshape(height, FINE, width, FINE).mean((1, 3))
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    return np.asarray(gathered * (1 + scene.uneven * (u + v) / 2))


def _information(light: Floats, px_from_squares: Floats, grid: Floats) -> Floats:
    """(count, 2, 2) 1/px^2 for noise of 1: what a patch that is moved as a whole changes. Its turns, blur, contrast and evenness change it
    alike on both sides of the corner, a shift oppositely; so those that are not known cost nothing."""
    down, right = np.gradient(light)
    height, width = light.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    squares = _projected(np.linalg.inv(px_from_squares), np.column_stack([x.ravel(), y.ravel()]))
    found = []
    for corner in grid:
        own = (np.abs(squares - corner) <= 0.5).all(1).reshape(light.shape)
        slopes = np.stack([right[own], down[own]])
        found.append(slopes @ slopes.T)
    return np.array(found)
