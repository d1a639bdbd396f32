"""A fisheye lens with what its polynomial leaves: a smooth displacement over the picture, of
bicubic B-splines, before it.

Source: mrcal's splined models (https://mrcal.secretsauce.net/splined-models.html). Its surface lies
    over the directions; here it lies
over the pixels, so that a pixel's ray needs no search.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.optics.fisheye import Fisheye
from calib.optics.params import Param, Values
from calib.optics.rays import Rays

SHIFTS = ("camera.spline_x", "camera.spline_y")
"""px, of the control points, row by row."""
GRID = "camera.spline_grid"
"""(4,) the picture's width and height, px, and the columns and rows of the control points."""
ITERATIONS = 100
CONVERGED = 1e-11
"""px"""
SIZE = 2e-3
"""Of the picture's longer side: the prior's standard deviation. What Kannala and Brandt's four
coefficients leave of a lens is some pixels in a thousand where it is much.
"""
REACH = 1.5
"""Spacings: the length over which it is correlated."""
ROUGHNESS = 1e-2
"""Of SIZE: the part of each control point that is its own, so that the covariance can be inverted.
"""


@dataclass(frozen=True, slots=True)
class Grid:
    """Control points, evenly over the picture and one spacing beyond it on every side."""

    size: tuple[int, int]
    """px, of the picture."""
    shape: tuple[int, int]
    """Columns and rows, 4 at least."""

    @staticmethod
    def of(values: Values) -> Grid:
        width, height, columns, rows = (int(number) for number in values[GRID])
        return Grid((width, height), (columns, rows))

    @property
    def described(self) -> Tensor:
        """(4,) as the values of a path keep it."""
        return torch.tensor([*self.size, *self.shape], dtype=torch.float64)

    @property
    def spacing(self) -> tuple[float, float]:
        """px"""
        (width, height), (columns, rows) = self.size, self.shape
        return width / (columns - 3), height / (rows - 3)

    def basis(self, pixels: Tensor) -> Tensor:
        """(..., 2) px to the (..., rows * columns) weights of the control points; beyond the
        picture as at its border.
        """
        along = (_weights((pixels[..., i] + 0.5) / self.spacing[i], self.shape[i]) for i in (0, 1))
        x, y = along
        return (y.unsqueeze(-1) * x.unsqueeze(-2)).flatten(-2)

    def prior_root(self) -> NDArray[np.float64]:
        """(n, n) px: R with R R^T the covariance of the control points, along x or y, beforehand: a
        smooth field that is zero where nothing says otherwise. Not to be written to.
        """
        return _prior_root(self)


@dataclass(frozen=True, slots=True)
class Splined:
    """Reads what a fisheye reads, and the control points."""

    grid: Grid
    base: Fisheye = field(default_factory=Fisheye)
    wide: ClassVar[bool] = True

    @property
    def pupil(self) -> tuple[Param, ...]:
        return self.base.pupil

    @property
    def params(self) -> tuple[Param, ...]:
        count = self.grid.shape[0] * self.grid.shape[1]
        return (*self.base.params, *(Param(name, "px", 0.1, (count,)) for name in SHIFTS))

    def with_pupil(self, pupil: tuple[Param, ...]) -> Splined:
        return replace(self, base=self.base.with_pupil(pupil))

    def __call__(self, pixels: Tensor, values: Values) -> Rays:
        return self.base(pixels + self._shift(pixels, values), values)

    def project(self, points: Tensor, values: Values) -> Tensor:
        """As the fisheye's, by fixed-point iteration."""
        goal = self.base.project(points, values)
        pixels = goal
        for _ in range(ITERATIONS):
            before, pixels = pixels, goal - self._shift(pixels, values)
            if bool(((pixels - before).abs() < CONVERGED).all()):
                break
        return pixels

    def _shift(self, pixels: Tensor, values: Values) -> Tensor:
        basis = self.grid.basis(pixels)
        return torch.stack([(values[name] * basis).sum(-1) for name in SHIFTS], -1)


def _weights(at: Tensor, count: int) -> Tensor:
    """(...) places in spacings from the picture's border to the (..., count) weights of cubic
    B-splines there.
    """
    at = at.clamp(0, count - 3)
    away = (at.unsqueeze(-1) + 1 - torch.arange(count, dtype=at.dtype, device=at.device)).abs()
    near, far = 2 / 3 - away**2 * (1 - away / 2), (2 - away) ** 3 / 6
    return torch.where(away < 1, near, torch.where(away < 2, far, torch.zeros_like(away)))


@lru_cache(maxsize=8)
def _prior_root(grid: Grid) -> NDArray[np.float64]:
    along = [
        np.exp(-((np.arange(n)[:, None] - np.arange(n)) ** 2) / (2 * REACH**2))
        for n in reversed(grid.shape)
    ]
    smooth = np.kron(*along) + ROUGHNESS**2 * np.eye(grid.shape[0] * grid.shape[1])
    return np.asarray(SIZE * max(grid.size) * np.linalg.cholesky(smooth), dtype=np.float64)
