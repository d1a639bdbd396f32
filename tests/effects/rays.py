"""Rays through uneven, turned and shifted covers, and where they land: numpy and bisection, sharing
nothing with calib.optics.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn
from scipy.spatial.transform import Rotation

from fixtures.synthetic import INTRINSICS
from tests.optics import oracle
from tests.optics.shapes import Example

Array = NDArray[np.float64]
Height = Callable[[float, float], float]


def nothing(first: float, second: float) -> float:
    del first, second
    return 0.0


@dataclass(frozen=True)
class Glass:
    """A cover."""

    example: Example
    parameters: Mapping[str, float]
    inner: Height = nothing
    """Chart coordinates to m: what the inner surface is uneven by."""
    outer: Height = nothing
    wedge: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector of the outer surface's frame against the inner one's, rad."""

    def rays(
        self, pixels: Array, origin: Array | None = None, turn: Array | None = None
    ) -> tuple[Array, Array]:
        """(N, 2) px to (N, 3) origins and directions behind it, of a camera at an origin,
        turned.
        """
        origin = np.zeros(3) if origin is None else origin
        glass, outside_index = self.parameters["refractive_index"], self.parameters["outside_index"]
        surfaces = [(self._inner, 1.0, glass), (self._outer, glass, outside_index)]
        launched = pinhole(pixels) if turn is None else pinhole(pixels) @ turn.T
        traced = [oracle.through(surfaces, origin, direction, 0.08) for direction in launched]
        return np.array([o for o, _ in traced]), np.array([d for _, d in traced])

    def _own(self, point: Array) -> Array:
        tilt = Rotation.from_rotvec(
            [self.parameters.get(f"tilt.{axis}", 0.0) for axis in "xyz"]
        ).as_matrix()
        return np.asarray((point - self.example.origin(self.parameters)) @ tilt)

    def _inner(self, point: Array) -> float:
        local = self._own(point)
        return self.example.height(local, self.parameters) - self.inner(*self.example.chart(local))

    def _outer(self, point: Array) -> float:
        local = self._own(point) @ Rotation.from_rotvec(self.wedge).as_matrix()
        return (
            self.example.height(local, self.parameters)
            - self.parameters["thickness"]
            - self.outer(*self.example.chart(local))
        )


def pinhole(pixels: Array) -> Array:
    """(N, 2) px to (N, 3) unit, without a lens."""
    offset = (pixels - [INTRINSICS.cx.value, INTRINSICS.cy.value]) / [
        INTRINSICS.fx.value,
        INTRINSICS.fy.value,
    ]
    directions = np.column_stack([offset, np.ones(len(offset))])
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def turned(**angles: float) -> Array:
    """A rotation by the angles (rad) about x, y and z, as one rotation vector."""
    return np.asarray(Rotation.from_rotvec([angles.get(axis, 0.0) for axis in "xyz"]).as_matrix())


def camera_matrix() -> Array:
    fx = INTRINSICS.fx.value
    fy = INTRINSICS.fy.value
    cx = INTRINSICS.cx.value
    cy = INTRINSICS.cy.value
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def projected(points: Array, pose: Array, matrix: Array | None = None) -> Array:
    """(N, 3) m on a board at a pose (6,) to (N, 2) px, by OpenCV, without a lens."""
    pixels = cv2.projectPoints(
        points, pose[:3], pose[3:6], camera_matrix() if matrix is None else matrix, np.zeros(4)
    )[0]
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def centres(
    low: tuple[float, float], high: tuple[float, float], grid: tuple[int, int]
) -> tuple[Array, tuple[float, float]]:
    """(n, 2) chart coordinates row by row, and their spacing."""
    rows = np.linspace(low[0], high[0], grid[0])
    columns = np.linspace(low[1], high[1], grid[1])
    return np.array([(first, second) for first in rows for second in columns]), (
        rows[1] - rows[0],
        columns[1] - columns[0],
    )


def waves(parameters: Array) -> Array:
    """(9, 9): a free field's displacement in the middles of 9 x 9 parts, from its (81,) numbers:
    scipy's DCT of type 3, which counts each wave but the constant one twice. Wave (m, n) counts 1 /
    (1 + (m^2 + n^2) / 4).
    """
    order = np.arange(9)
    once = np.where(order > 0, 0.5, 1.0)
    return np.asarray(
        dctn(
            parameters.reshape(9, 9)
            / (1 + (order[:, None] ** 2 + order**2) / 4)
            * np.outer(once, once),
            type=3,
        )
    )
