"""Pictures of a checkerboard, made fast: a print warped by a homography, apart from `calib` and
from the renderer of the fixtures.

The print is warped into a picture of 3x3 samples per pixel, blurred there by lens and motion, put
before a background of clutter, dimmed towards the corners, and given the noise of a sensor.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

FINE = 3  # samples per pixel, each way
TEXEL = 96  # px of the print, side of a square: finer than the samples, so that the nearest will do
MARGIN = 1.0  # squares of white around the print


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The picture that the lens gives, before the sensor."""

    light: NDArray[np.float32]
    """(H, W) grey levels without noise, not cut off at 255."""
    corners: NDArray[np.float64]
    """(count, 2) px."""

    def exposed(self, rng: np.random.Generator, gain: float = 1.0) -> NDArray[np.uint8]:
        """(H, W): with the noise of reading and of photons, and cut off."""
        light = gain * self.light
        noise = rng.standard_normal(light.shape, np.float32)
        return np.asarray(
            np.clip(np.rint(light + noise * np.sqrt(1 + light / 150)), 0, 255), np.uint8
        )


def warped_view(
    rng: np.random.Generator,
    columns: int,
    rows: int,
    size: tuple[int, int],
    defocus: float = 0.6,
    motion: tuple[float, float] = (0, 0),
) -> View:
    """A board in a random pose, wholly in a picture of this width and height, its squares at least
    13 px apart.

    Args:
        defocus: px, sigma of the lens's blur.
        motion: px, how far the board moves in x and y while the shutter is open.
    """
    width, height = size
    px_from_print = _pose(rng, columns, rows, size)
    fine_from_px = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1]])
    sheet = _print(columns, rows)
    fine_size = FINE * width, FINE * height
    paper = cv2.warpPerspective(
        sheet, fine_from_px @ px_from_print, fine_size, flags=cv2.INTER_NEAREST
    )
    clutter = cv2.resize(_clutter(rng, size), fine_size, interpolation=cv2.INTER_NEAREST)
    fine = cv2.GaussianBlur(
        np.where(paper > 0, paper, clutter).astype(np.float32), (0, 0), FINE * defocus
    )
    if any(motion):
        fine = cv2.filter2D(fine, -1, _streak(FINE * motion[0], FINE * motion[1]))
    light = np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.float32)
    u, v = (
        np.linspace(-1, 1, width, dtype=np.float32),
        np.linspace(-1, 1, height, dtype=np.float32)[:, None],
    )
    inner = (
        np.stack(np.meshgrid(np.arange(1, columns + 1), np.arange(1, rows + 1)), -1).reshape(-1, 2)
        + MARGIN
    )
    corners = np.asarray(
        cv2.perspectiveTransform((inner * TEXEL - 0.5).reshape(-1, 1, 2), px_from_print), np.float64
    ).reshape(-1, 2)
    return View(light * np.float32(rng.uniform(0.6, 1.0)) * (1 - 0.12 * (u**2 + v**2)), corners)


def clutter_view(rng: np.random.Generator, size: tuple[int, int]) -> View:
    """No board."""
    light = cv2.GaussianBlur(_clutter(rng, size).astype(np.float32), (0, 0), 0.6)
    return View(np.asarray(light, np.float32), np.empty((0, 2)))


def motion_blurred(picture: NDArray, motion: tuple[float, float]) -> NDArray:
    """A picture whose light moved in x and y by this many px while the shutter was open."""
    return np.asarray(cv2.filter2D(picture, -1, _streak(*motion), borderType=cv2.BORDER_REPLICATE))


def _pose(
    rng: np.random.Generator, columns: int, rows: int, size: tuple[int, int]
) -> NDArray[np.float64]:
    """(3, 3) px from the print's pixels, drawn until the board with half its margin is in the
    picture and large enough.
    """
    focal = 0.78 * size[0]
    camera = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    wide, high = columns + 1 + 2 * MARGIN, rows + 1 + 2 * MARGIN
    squares_from_texels = np.array(
        [[1 / TEXEL, 0, -wide / 2], [0, 1 / TEXEL, -high / 2], [0, 0, 1]]
    )
    edge = MARGIN * TEXEL / 2
    outline = np.array(
        [
            [edge, edge],
            [wide * TEXEL - edge, edge],
            [edge, high * TEXEL - edge],
            [wide * TEXEL - edge, high * TEXEL - edge],
        ]
    )
    while True:
        rotation = np.eye(3)
        for axis, largest in zip(np.eye(3), (0.7, 0.7, np.pi), strict=True):
            rotation = rotation @ cv2.Rodrigues(axis * rng.uniform(-largest, largest))[0]
        distance = float(np.exp(rng.uniform(np.log(8), np.log(70))))
        place = np.array([*rng.uniform(-0.5, 0.5, 2) * np.array(size) / focal * distance, distance])
        px_from_print = camera @ np.column_stack([rotation[:, :2], place]) @ squares_from_texels
        projected = cv2.perspectiveTransform(outline.reshape(-1, 1, 2), px_from_print).reshape(
            -1, 2
        )
        sides = np.linalg.norm(np.diff(projected[[0, 1, 3, 2, 0]], axis=0), axis=1) / np.array(
            [wide - 1, high - 1, wide - 1, high - 1]
        )
        if (projected > 0).all() and (projected < np.array(size) - 1).all() and sides.min() > 13:
            return np.asarray(px_from_print)


def _print(columns: int, rows: int) -> NDArray[np.uint8]:
    """The print with its margin. No part of it is 0."""
    squares = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2
    sheet = np.kron(np.where(squares == 0, 25, 215), np.ones((TEXEL, TEXEL)))
    return np.asarray(np.pad(sheet, round(MARGIN * TEXEL), constant_values=215), np.uint8)


def _clutter(rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.uint8]:
    """(H, W): cloth, paper and things with edges."""
    width, height = size
    picture = np.zeros((height, width), np.float32)
    for scale in (2, 8, 40, 200):
        coarse = rng.normal(0, 15, (height // scale + 2, width // scale + 2)).astype(np.float32)
        picture += cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
    picture += np.float32(rng.uniform(60, 140))
    for _ in range(40):
        middle, extent = rng.uniform(0, 1, 2) * size, np.exp(rng.uniform(2, 5, 2)) * width / 1640
        box = cv2.boxPoints((tuple(middle), tuple(extent), float(rng.uniform(0, 90))))
        cv2.fillPoly(picture, [np.rint(box).astype(np.int32)], float(rng.uniform(10, 240)))
    return np.asarray(np.clip(picture, 0, 255), np.uint8)


def _streak(x: float, y: float) -> NDArray[np.float32]:
    """The kernel of a straight motion."""
    half = int(np.ceil(np.hypot(x, y) / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for fraction in np.linspace(-0.5, 0.5, 201):
        column, row = half + fraction * x, half + fraction * y
        i, j = int(column), int(row)
        u, v = column - i, row - j
        kernel[j : j + 2, i : i + 2] += np.outer((1 - v, v), (1 - u, u)).astype(np.float32)
    return np.asarray(kernel / kernel.sum(), np.float32)
