"""Views through covers by a ray tracer that shares nothing with calib.optics: numpy, all rays at
once, bisection, numeric normals, Snell's law for vectors.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.session.board import Board

Array = NDArray[np.float64]
Height = Callable[[Array], Array]
"""The (N,) m height of (N, 3) points of the camera frame above a surface, negative inside."""
See = Callable[[Array], Array]
"""The (N, 2) px of (N, 3) points of the camera frame."""

SIZE = (1640, 1232)
FOCAL = 1280.0
CENTRE = np.array([830.0, 620.0])
BOARD = Board(9, 9, 0.020)
NOISE = 0.01
"""px"""
SETTLED = 1e-9
"""m: 3e-6 px; numeric normals are no better."""


def project(points: Array) -> Array:
    """Return the (N, 2) px of a pinhole."""
    return np.asarray(FOCAL * points[:, :2] / points[:, 2:] + CENTRE)


def launch(pixels: Array) -> Array:
    """Return the (N, 3) unit rays of a pinhole."""
    rays = np.column_stack([(pixels - CENTRE) / FOCAL, np.ones(len(pixels))])
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def trace(surfaces: Sequence[tuple[Height, float, float]], pixels: Array) -> tuple[Array, Array]:
    """Return the (N, 3) origins and directions behind surfaces. Each surface has the indices of
    what is before and behind it.
    """
    directions = launch(pixels)
    origins = np.zeros_like(directions)
    for height, n_from, n_to in surfaces:
        low = np.zeros(len(pixels))
        high = np.full(len(pixels), 0.5)
        for _ in range(55):
            middle = (low + high) / 2
            is_inside = height(origins + middle[:, None] * directions) < 0
            low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
        origins = origins + low[:, None] * directions
        steps = np.eye(3) * 1e-6
        slopes = [height(origins + step) - height(origins - step) for step in steps]
        normals = np.stack(slopes, -1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        cosines = (directions * normals).sum(-1, keepdims=True)
        lateral = n_from / n_to * (directions - cosines * normals)
        directions = lateral + normals * np.sqrt(1 - (lateral**2).sum(-1, keepdims=True))
    return origins, directions


def seen_through(surfaces: Sequence[tuple[Height, float, float]]) -> See:
    """Return the projection through these surfaces: a pixel moves until its ray meets the point."""

    def see(points: Array) -> Array:
        pixels = project(points)
        for _ in range(60):
            origins, directions = trace(surfaces, pixels)
            reach = (points[:, 2:] - origins[:, 2:]) / directions[:, 2:]
            miss = points[:, :2] - (origins + reach * directions)[:, :2]
            pixels = pixels + FOCAL / points[:, 2:] * miss
            if np.abs(miss).max() < SETTLED:
                return pixels
        raise AssertionError("the pixels do not settle")

    return see


def rotate(vector: Array, points: Array) -> Array:
    """Turn (N, 3) points by a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if not angle:
        return points
    axis = vector / angle
    return np.asarray(
        np.cos(angle) * points
        + np.sin(angle) * np.cross(axis, points)
        + (1 - np.cos(angle)) * (points @ axis)[:, None] * axis
    )


def views(see: See, count: int, seed: int) -> tuple[View, ...]:
    """Return views of boards at 0.25 to 0.6 m, with every corner in the picture, and with noise."""
    rng = np.random.default_rng(seed)
    flat = np.column_stack([BOARD.points(), np.zeros(BOARD.count)])
    taken: list[View] = []
    while len(taken) < count:
        depth = rng.uniform(0.25, 0.6)
        middle = np.array([*rng.uniform(-0.3, 0.3, 2) * depth, depth])
        turn = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.2, 0.2)])
        points = rotate(turn, flat) + middle
        if (np.abs(project(points) - np.array(SIZE) / 2) > np.array(SIZE) / 2 - 50).any():
            continue
        pixels = see(points)
        if (np.abs(pixels - np.array(SIZE) / 2) > np.array(SIZE) / 2 - 10).any():
            continue
        pixels = pixels + rng.normal(0, NOISE, pixels.shape)
        taken.append(View(f"{len(taken):04d}.png", pixels, np.ones(BOARD.count)))
    return tuple(taken)


def write_session(folder: Path, cover: object, taken: tuple[View, ...]) -> Path:
    """Write a session with this section `cover`. Its camera and its lens are as they are."""
    folder.mkdir(parents=True, exist_ok=True)
    intrinsics = {"fx": FOCAL, "fy": FOCAL, "cx": float(CENTRE[0]), "cy": float(CENTRE[1])}
    camera = {"width": SIZE[0], "height": SIZE[1], "intrinsics": intrinsics}
    board = {"columns": BOARD.columns, "rows": BOARD.rows, "square_mm": 1e3 * BOARD.square}
    session = {"format": 1, "board": board, "camera": camera, "cover": cover}
    text = yaml.safe_dump(session | {"corners": "corners.vnl"}, sort_keys=False)
    (folder / "session.yaml").write_text(text)
    write_corners(folder / "corners.vnl", taken)
    return folder
