"""Corners by maximum likelihood: the patch model that fits the pixels best, and what their noise leaves uncertain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice
from calib.corners.patch_model import (
    CONTRAST,
    FIRST_ANGLE,
    FIRST_BLUR,
    HALO_STRENGTH,
    MIDDLE,
    PARAMETERS,
    SECOND_ANGLE,
    SECOND_BLUR,
    predicted,
)
from calib.corners.patch_noise import inflation
from calib.corners.patches import Patches
from calib.session.board import Board

Floats = NDArray[np.float64]

HALF_WIDTHS = (3, 5, 9)  # px to both sides of an edge; the first is tried first
FEW, MANY = 16, 96  # places along an edge, where pixels are taken: a few to come near, then all but of the largest squares
WIDEST_BLUR = 0.33  # of a half-width, that it can hold
BLUR = 0.8  # px, to start with
BLURS = [FIRST_BLUR, SECOND_BLUR]
BLUR_LIMITS = (np.log(0.45), np.log(6.0))  # of px
STEPS = 10  # at most
SETTLED = 0.03  # px: after a step this short, the next would be of its square over the blur
DAMPING = 1e-3
OUTLYING = 3.0  # standard deviations of a pixel's noise, from which on it weighs less
LEAST_NOISE = 0.29  # grey levels: rounding's own
SIGMA = 1.4826  # of a Gaussian over its median absolute deviation


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """N patches, fitted."""

    parameters: Floats
    """(N, 11), as in `PARAMETERS`."""
    unit_covariances: Floats
    """(N, 2, 2) px^2 of the place, for pixels' noise of one grey level, each pixel's independent of the others'."""
    inflation: float
    """Grey levels^2: what the picture's own noise makes of that."""
    misfit: Floats
    """(N,) root mean square of the residuals over the contrast."""
    heights: Floats
    """(N, 2 edges) px, as of the lattice."""


def fit_patches(grey: NDArray, corners: Floats, board: Board, known: Lattice | None = None) -> Fit:
    """Fit the patch of every corner.

    Args:
        grey: (H, W) uint8 or uint16.
        corners: (count, 2) px, a regular grid, each off by less than a blur. Some may be NaN.
        board: its columns and rows.
        known: of those that are not NaN. None: as they themselves say, before the fit and near its end.

    Returns:
        Of the N corners that are not NaN.
    """
    lattice = known or Lattice.of(corners, board)
    brightest = float(np.iinfo(grey.dtype).max)
    for half_width in HALF_WIDTHS:
        coarse, fine = (Patches.of(grey, lattice, half_width, places) for places in (FEW, MANY))
        near = _Descent(coarse, lattice.curvatures, brightest, _start(coarse, lattice))
        near.run()
        curvatures = lattice.curvatures
        if not known:
            moved = corners.copy()
            moved[np.isfinite(corners[:, 0])] += near.parameters[:, :2]
            curvatures = Lattice.of(moved, board).curvatures
        descent = _Descent(fine, curvatures, brightest, near.parameters)
        descent.run()
        if np.exp(np.median(descent.parameters[:, BLURS])) <= WIDEST_BLUR * half_width:
            break
    return descent.result(lattice.heights)


class _Descent:
    """Levenberg's and Marquardt's steps, of all corners at once, each with a damping of its own."""

    def __init__(self, patches: Patches, curvatures: Floats, brightest: float, start: Floats) -> None:
        self._patches, self._curvatures = patches, curvatures
        self._clipped = (0.0, brightest)
        self.parameters = start
        self._used = int(patches.used.sum())
        self._damping = np.full(len(self.parameters), DAMPING)
        self._evaluate()

    def _evaluate(self) -> None:
        light, self._jacobian = predicted(self.parameters, self._patches, self._curvatures, self._clipped)
        self._normal = np.matmul(self._jacobian, self._jacobian.swapaxes(1, 2)).astype(np.float64)
        self._residuals = (self._patches.light - light) * self._patches.used

    def run(self) -> None:
        for _ in range(STEPS):
            if self._step() < SETTLED:
                return

    def _step(self) -> float:
        """One step of every corner that gains by it; px, of the longest."""
        noise = self.noise()
        bulk = self._bulk(noise)
        normal = self._normal - self._lost(bulk)
        gradient = np.matmul(self._jacobian, bulk[..., None]).astype(np.float64)
        blurring = (self.parameters[:, HALO_STRENGTH] <= 0) & (gradient[:, HALO_STRENGTH, 0] <= 0)
        normal[blurring, HALO_STRENGTH], normal[blurring, :, HALO_STRENGTH], gradient[blurring, HALO_STRENGTH] = 0, 0, 0
        diagonal = np.arange(len(PARAMETERS))
        normal[:, diagonal, diagonal] *= 1 + self._damping[:, None]
        normal[:, diagonal, diagonal] += 1e-6
        step = np.linalg.solve(normal, gradient)[..., 0]
        size = float(np.abs(step[:, :2]).max())
        if size < SETTLED:
            self.parameters = self.parameters + step
            self._residuals -= np.matmul(step[:, None].astype(np.float32), self._jacobian)[:, 0]
            return size
        before = self.parameters, self._residuals, self._jacobian, self._normal
        cost = _cost(self._residuals, OUTLYING * noise)
        self.parameters = before[0] + step
        self.parameters[:, BLURS] = np.clip(self.parameters[:, BLURS], *BLUR_LIMITS)
        self.parameters[:, HALO_STRENGTH] = np.maximum(self.parameters[:, HALO_STRENGTH], 0)  # the blur has a parameter of its own
        self._evaluate()
        better = _cost(self._residuals, OUTLYING * noise) <= cost * (1 + 1e-6)
        self._damping = np.where(better, self._damping / 10, self._damping * 10)
        if not better.all():
            self.parameters = np.where(better[:, None], self.parameters, before[0])
            self._residuals = np.where(better[:, None], self._residuals, before[1])
            self._jacobian[~better], self._normal[~better] = before[2][~better], before[3][~better]
        return size

    def noise(self) -> float:
        """Grey levels, of the bulk of the pixels."""
        size = np.abs(self._residuals).ravel()
        middle = size.size - self._used / 2  # those that are not used are 0
        ends = int(np.ceil(middle)) - 1, int(middle)
        return max(SIGMA * float(np.partition(size, ends)[list(ends)].mean()), LEAST_NOISE)

    def _bulk(self, noise: float) -> NDArray[np.float32]:
        """(N, P) the residuals, no larger than where they begin to weigh less."""
        return np.asarray(np.clip(self._residuals, -OUTLYING * noise, OUTLYING * noise))

    def _lost(self, bulk: NDArray[np.float32]) -> Floats:
        """(N, 11, 11) by how much less the outlying pixels tell than others do."""
        lost = np.zeros(self._normal.shape)
        corner, pixel = np.nonzero(bulk != self._residuals)
        part = 1 - bulk[corner, pixel] / self._residuals[corner, pixel]
        rows = self._jacobian[corner, :, pixel].astype(np.float64)
        ends = np.searchsorted(corner, np.arange(len(lost) + 1))
        for own in np.flatnonzero(np.diff(ends)).tolist():
            some = slice(ends[own], ends[own + 1])
            lost[own] = (rows[some] * part[some, None]).T @ rows[some]
        return lost

    def result(self, heights: Floats) -> Fit:
        normal = self._normal.copy()
        normal[:, np.arange(len(PARAMETERS)), np.arange(len(PARAMETERS))] += 1e-6
        inverse = np.linalg.inv(normal)
        bulk = self._bulk(self.noise())
        squared = (self._residuals**2).sum(1) / np.maximum(self._patches.used.sum(1), 1)
        misfit = np.sqrt(squared) / np.maximum(np.abs(self.parameters[:, CONTRAST]), 1e-6)
        grown = inflation(self._jacobian, bulk, inverse, self._patches.half_width)
        return Fit(self.parameters, inverse[:, :2, :2], grown, misfit, heights)


def _start(patches: Patches, lattice: Lattice) -> Floats:
    (first, second) = lattice.angles.T.astype(np.float32)[:, :, None]
    above = patches.y * np.cos(first) - patches.x * np.sin(first)
    left = patches.y * np.cos(second) - patches.x * np.sin(second)
    pixels = np.maximum(patches.used.sum(1), 1)
    middle = (patches.light * patches.used).sum(1) / pixels
    pattern = np.sign(above * left) * patches.used
    parameters = np.zeros((len(pixels), len(PARAMETERS)))
    parameters[:, [FIRST_ANGLE, SECOND_ANGLE]] = lattice.angles
    parameters[:, BLURS] = np.log(BLUR * patches.half_width / HALF_WIDTHS[0])
    parameters[:, MIDDLE] = middle
    parameters[:, CONTRAST] = ((patches.light - middle[:, None]) * pattern).sum(1) / pixels
    return parameters


def _cost(residuals: NDArray[np.float32], outlying: float) -> Floats:
    """(N,) Huber's, of (N, P)."""
    size = np.abs(residuals) / np.float32(outlying)
    return np.asarray(np.where(size < 1, size**2, 2 * size - 1).sum(1), np.float64)
