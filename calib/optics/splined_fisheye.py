"""A fisheye lens behind a smooth displacement of the pixels, a bicubic B-spline surface over the
picture. The surface models the part of the lens that the fisheye's polynomial cannot.

Source: mrcal's splined models (https://mrcal.secretsauce.net/splined-models.html). There the
surface is a function of the direction; here it is a function of the pixel, so that a pixel's ray
needs no iteration.
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
from calib.optics.lens import Pull, launch_by_autograd
from calib.optics.params import Param, Values
from calib.optics.rays import Rays
from calib.session.parameter_names import CAMERA

SHIFTS = (CAMERA.of("spline_x"), CAMERA.of("spline_y"))
"""The displacements of the control points along x and y, px, row by row."""
ITERATIONS = 100
CONVERGED = 1e-11
"""px"""
PRIOR_SCALE = 2e-3
"""The prior's standard deviation as a fraction of the picture's longer side. A large error of
Kannala and Brandt's four coefficients is a few pixels in a thousand.
"""
CORRELATION_LENGTH = 1.5
"""The correlation length of the prior, in spacings of the control points."""
ROUGHNESS = 1e-2
"""The independent standard deviation of each control point as a fraction of the prior's, so that
the covariance can be inverted.
"""


@dataclass(frozen=True, slots=True)
class Grid:
    """A regular grid of control points over the picture and one spacing beyond its border."""

    size: tuple[int, int]
    """The picture's width and height, px."""
    shape: tuple[int, int]
    """Columns and rows, at least 4 each."""

    @property
    def spacing(self) -> tuple[float, float]:
        """The distance between neighbouring control points along x and y, px."""
        (width, height), (columns, rows) = self.size, self.shape
        return width / (columns - 3), height / (rows - 3)

    def basis(self, pixels: Tensor) -> Tensor:
        """Return the (..., rows * columns) weights of the control points at (..., 2) px. A pixel
        beyond the picture has the weights of the nearest border point.
        """
        x = _spline_weights((pixels[..., 0] + 0.5) / self.spacing[0], self.shape[0])
        y = _spline_weights((pixels[..., 1] + 0.5) / self.spacing[1], self.shape[1])
        return (y.unsqueeze(-1) * x.unsqueeze(-2)).flatten(-2)

    def prior_root(self) -> NDArray[np.float64]:
        """Return the (n, n) px matrix R such that R R^T is the prior covariance of the control
        points' displacements along x (or along y): a smooth field with mean zero. The array is
        shared; do not write to it.
        """
        return _prior_root(self)


@dataclass(frozen=True, slots=True)
class SplinedFisheye:
    """A lens that reads the values of a fisheye and the displacements of the control points."""

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

    def with_pupil(self, pupil: tuple[Param, ...]) -> SplinedFisheye:
        return replace(self, base=self.base.with_pupil(pupil))

    def __call__(self, pixels: Tensor, values: Values, _near: Tensor | None = None, /) -> Rays:
        return self.base(pixels + self._shift(pixels, values), values)

    def launch(
        self, pixels: Tensor, values: Values, names: frozenset[str], near: Tensor | None = None, /
    ) -> tuple[Rays, Pull]:
        return launch_by_autograd(self, pixels, values, names, near)

    def project(self, points: Tensor, values: Values) -> Tensor:
        """Return the (..., 2) px of (..., 3) m points, from the fisheye's pixels by fixed-point
        iteration.
        """
        goal = self.base.project(points, values)
        pixels = goal
        for _ in range(ITERATIONS):
            previous = pixels
            pixels = goal - self._shift(pixels, values)
            if bool(((pixels - previous).abs() < CONVERGED).all()):
                break
        return pixels

    def _shift(self, pixels: Tensor, values: Values) -> Tensor:
        basis = self.grid.basis(pixels)
        return torch.stack([(values[name] * basis).sum(-1) for name in SHIFTS], -1)


def _spline_weights(positions: Tensor, count: int) -> Tensor:
    """Return the (..., count) weights of cubic B-splines at (...) positions, in spacings from the
    picture's border.
    """
    positions = positions.clamp(0, count - 3)
    centres = torch.arange(count, dtype=positions.dtype, device=positions.device)
    distance = (positions.unsqueeze(-1) + 1 - centres).abs()
    inner = 2 / 3 - distance**2 * (1 - distance / 2)
    outer = (2 - distance) ** 3 / 6
    return torch.where(
        distance < 1, inner, torch.where(distance < 2, outer, torch.zeros_like(distance))
    )


@lru_cache(maxsize=8)
def _prior_root(grid: Grid) -> NDArray[np.float64]:
    columns, rows = grid.shape
    smooth = np.kron(_correlation(rows), _correlation(columns))
    covariance = smooth + ROUGHNESS**2 * np.eye(rows * columns)
    root = PRIOR_SCALE * max(grid.size) * np.linalg.cholesky(covariance)
    return np.asarray(root, dtype=np.float64)


def _correlation(count: int) -> NDArray[np.float64]:
    """Return the (count, count) correlations of a row of control points."""
    distance = np.arange(count)[:, None] - np.arange(count)
    return np.asarray(np.exp(-(distance**2) / (2 * CORRELATION_LENGTH**2)), dtype=np.float64)
