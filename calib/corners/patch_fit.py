"""Corners by maximum likelihood: the patch model that fits the pixels best, and what their noise
leaves uncertain.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice
from calib.corners.patch_model import (
    ANGLES,
    BLURS,
    CONTRAST,
    FIRST_BLUR,
    HALO_STRENGTH,
    MIDDLE,
    PARAMETERS,
    PLACE,
    SECOND_BLUR,
    SECOND_FIRST,
    Expected,
    by_distances,
)
from calib.corners.patch_noise import chunks, inflation
from calib.corners.patches import Patches, patches_of
from calib.session.board import Board

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

HALF_WIDTHS = (3, 5, 9)  # px to both sides of an edge: the first that holds the blur
FEW, MANY = (
    14,
    96,
    # places along an edge, where pixels are taken: at least so many to come near, then all but of
    # the largest squares
)
WIDEST_BLUR = 0.33  # of a half-width, that it can hold
BLUR = 0.8  # px, to start with
BLUR_LIMITS = (np.log(0.3), np.log(6.0))  # of px
LIMITS = {
    FIRST_BLUR: BLUR_LIMITS,
    SECOND_BLUR: BLUR_LIMITS,
    HALO_STRENGTH: (0.0, np.inf),
}  # where a step would leave them, they stay
STEPS = 10  # at most
SETTLED = 0.03  # px: after a step this short, the next would be of its square over the blur
SHAPED = 0.3  # likewise, of the logarithms of blurs, and of the halo
GAINED = 0.5  # likewise, of the squared residuals
MUCH_CUT, CUT = (
    0.1,
    0.1,
)  # of a corner's pixels; and of the steps that settle it, where so many are cut off
DAMPING = 1e-3
OUTLYING = 3.0  # standard deviations of a pixel's noise, from which on it weighs less
LEAST_NOISE = 0.29  # grey levels: rounding's own
LEAST = 1e-6  # of a normal matrix: what no pixel tells has no step
SAMPLED = 3  # every third pixel tells the noise
SIGMA = 1.4826  # of a Gaussian over its median absolute deviation


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """N patches, fitted."""

    parameters: Floats
    """(N, 11), as in `PARAMETERS`."""
    unit_covariances: Floats
    """(N, 2, 2) px^2 of the place, for pixels' noise of one grey level, each pixel's independent of
    the others'.
    """
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
        known: of those that are not NaN. None: as they themselves say, before the fit and near its
            end.

    Returns:
        Of the N corners that are not NaN.
    """
    lattice = known or Lattice.of(corners, board)
    brightest = float(np.iinfo(grey.dtype).max)
    near: _Descent | None = None
    for half_width in HALF_WIDTHS:
        patches = patches_of(grey, lattice, half_width, MANY)
        few = patches.thinned(FEW)
        start = near.parameters if near else _start(few, lattice)
        near = _Descent(few, lattice.curvatures, brightest, start, [slice(0, len(few.places))])
        if np.exp(np.median(near.parameters[:, BLURS])) <= WIDEST_BLUR * half_width:
            break
    assert near is not None
    curvatures = lattice.curvatures
    if not known:
        moved = corners.copy()
        moved[np.isfinite(corners[:, 0])] += near.parameters[:, PLACE]
        curvatures = Lattice.of(moved, board).curvatures
    return _Descent(
        patches, curvatures, brightest, near.parameters, chunks(len(patches.places), edges=2)
    ).result(lattice.heights)


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Of N corners, whose pixels are summed in C chunks.

    In place of x and y, they have the px across each edge.
    """

    by_chunk: NDArray[np.float32]
    """(C, N, 11, 12) normal matrices, and gradients as their last columns."""
    normals: Floats
    """(N, 11, 11) of all pixels."""
    gradients: Floats
    """(N, 11)"""
    squared: Floats
    """(N,) grey levels^2, of all residuals."""

    @staticmethod
    def of(by_chunk: NDArray[np.float32], squared: Floats) -> "_Equations":
        every = by_chunk.sum(0, dtype=np.float64)
        return _Equations(by_chunk, every[..., :-1], every[..., -1], squared)

    def step(self, parameters: Floats, damping: Floats) -> Floats:
        """(N, 11), from these parameters, with (N,) dampings."""
        normal, gradient = self.normals.copy(), self.gradients.copy()
        for shape, (least, most) in LIMITS.items():
            value, pull = parameters[:, shape], gradient[:, shape]
            stopped = ((value <= least) & (pull <= 0)) | ((value >= most) & (pull >= 0))
            normal[stopped, shape], normal[stopped, :, shape], gradient[stopped, shape] = 0, 0, 0
        diagonal = np.einsum("nkk->nk", normal)
        diagonal *= 1 + damping[:, None]
        diagonal += LEAST
        return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0])

    def put(self, corners: Indices, others: "_Equations") -> None:
        """Those of a few corners."""
        self.by_chunk[:, corners] = others.by_chunk
        for mine, other in (
            (self.normals, others.normals),
            (self.gradients, others.gradients),
            (self.squared, others.squared),
        ):
            mine[corners] = other


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """What the patches of N corners look like, beside what they should."""

    patches: Patches
    expected: Expected
    residuals: NDArray[np.float32]
    """(2N, P) grey levels, 0 where no pixel is used."""
    told: NDArray[np.float32]
    """(2N, P) 1, or 0 where no pixel is used, or what is expected lies beyond what the sensor can
    tell.
    """

    @staticmethod
    def of(
        parameters: Floats, patches: Patches, curvatures: Floats, brightest: float
    ) -> "_Compared":
        second = parameters[:, SECOND_FIRST]
        second[:, PLACE] = parameters[:, PLACE]
        expected = Expected.of(
            np.concatenate([parameters, second]),
            patches,
            np.concatenate([curvatures, curvatures[:, ::-1]]),
        )
        light, told = expected.light, patches.used
        if light.min() <= 0 or light.max() >= brightest:
            told = told * ((light > 0) & (light < brightest))
            light = np.clip(light, 0, brightest)
        residuals = patches.light - light
        residuals *= patches.used
        return _Compared(patches, expected, residuals, told)

    def noise(self) -> float:
        """Grey levels, of the bulk of the pixels that tell any."""
        told = self.told[:, ::SAMPLED]
        size = np.abs(self.residuals[:, ::SAMPLED] * told).ravel()
        middle = size.size - 1 - np.count_nonzero(told) // 2  # the others are 0
        return max(SIGMA * float(np.partition(size, middle)[middle]), LEAST_NOISE)

    def trust(self) -> Floats:
        """(N,) 1, or less where much is cut off: which pixels tell anything depends on the
        parameters there, and a step is no last one.
        """
        if self.told is self.patches.used:
            return np.ones(len(self.told) // 2)
        cut = _by_corner(self.told.sum(1)) < (1 - MUCH_CUT) * _by_corner(self.patches.used.sum(1))
        return np.where(cut, CUT, 1.0)

    def cost(self, outlying: float) -> Floats:
        """(N,) Huber's."""
        size = np.abs(self.residuals) * np.float32(1 / outlying)
        bulk = np.minimum(size, 1)
        return _by_corner((bulk * (2 * size - bulk)).sum(1))

    def equations(self, outlying: float, places: list[slice]) -> _Equations:
        """Residuals above so many grey levels weigh less; `places` along an edge are summed
        together.
        """
        corners, across = len(self.residuals) // 2, self.patches.across
        pieces = [slice(part.start * across, part.stop * across) for part in places]
        rows = np.empty((len(PARAMETERS) + 1, corners, self.residuals.shape[1]), np.float32)
        columns = rows.swapaxes(0, 1)
        sums = np.empty((2, len(pieces), corners, len(PARAMETERS), len(rows)), np.float32)
        for edge, own in enumerate((slice(corners), slice(corners, None))):
            roots = np.abs(self.residuals[own])  # of the weights
            np.maximum(roots, np.float32(outlying), out=roots)
            np.divide(np.float32(outlying), roots, out=roots)
            np.sqrt(roots, out=roots)
            roots *= self.told[own]
            np.multiply(roots, self.residuals[own], out=rows[-1])
            self.expected.some(own).derivatives(
                roots, [rows[at] for at in SECOND_FIRST] if edge else list(rows)
            )
            for at, piece in enumerate(pieces):
                part = columns[..., piece]
                np.matmul(
                    part[:, :-1], part.swapaxes(1, 2), out=sums[edge, at]
                )  # of two shapes: of one with itself is slower
        squared = _by_corner(np.einsum("rp,rp->r", self.residuals, self.residuals))
        return _Equations.of(sums.reshape(-1, *sums.shape[2:]), squared)


class _Descent:
    """Levenberg's and Marquardt's steps, of all corners at once, each with a damping of its own,
    and each until they are short.
    """

    def __init__(
        self,
        patches: Patches,
        curvatures: Floats,
        brightest: float,
        start: Floats,
        places: list[slice],
    ) -> None:
        """`places` along an edge are summed together."""
        self.parameters = start
        self._patches, self._curvatures, self._brightest, self._places = (
            patches,
            curvatures,
            brightest,
            places,
        )
        self._run(np.arange(len(start)), start)

    def _run(self, corners: Indices, here: Floats) -> None:
        patches, curvatures, damping = self._patches, self._curvatures, np.full(len(here), DAMPING)
        compared = _Compared.of(here, patches, curvatures, self._brightest)
        noise = np.inf
        for _ in range(STEPS):
            noise = min(noise, compared.noise())
            equations = compared.equations(OUTLYING * noise, self._places)
            step = equations.step(here, damping)
            moved = (by_distances(here) @ step[:, PLACE, None])[..., 0]
            tried = here + np.concatenate([moved, step[:, 2:]], 1)
            far = (
                np.maximum(
                    np.abs(moved).max(1) / SETTLED, np.abs(step[:, list(LIMITS)]).max(1) / SHAPED
                )
                >= compared.trust()
            )
            far |= (equations.gradients * step).sum(1) > GAINED * equations.squared
            self._keep(
                corners,
                np.where(far[:, None], here, tried),
                np.where(far[:, None], 0, step),
                equations,
            )
            if not far.any():
                return
            cost = compared.cost(OUTLYING * noise)
            if not far.all():
                patches, corners = patches.of_corners(np.flatnonzero(far)), corners[far]
                here, tried, damping, cost, curvatures = (
                    part[far] for part in (here, tried, damping, cost, curvatures)
                )
            for shape, limits in LIMITS.items():
                tried[:, shape] = np.clip(tried[:, shape], *limits)
            compared = _Compared.of(tried, patches, curvatures, self._brightest)
            better = compared.cost(OUTLYING * noise) <= cost * (1 + 1e-6)
            damping = np.where(better, damping / 10, damping * 10)
            here = np.where(better[:, None], tried, here)
            if not better.all():
                compared = _Compared.of(here, patches, curvatures, self._brightest)

    def _keep(
        self, corners: Indices, parameters: Floats, last: Floats, equations: _Equations
    ) -> None:
        """What was found for these, and the step that led there from where the equations hold."""
        if len(corners) == len(self.parameters):
            self.parameters, self._last, self._equations = parameters, last, equations
        else:
            self.parameters[corners], self._last[corners] = parameters, last
            self._equations.put(corners, equations)

    def result(self, heights: Floats) -> Fit:
        equations, last = self._equations, self._last
        normals, gradients = equations.by_chunk[..., :-1], equations.by_chunk[..., -1]
        less = (normals @ last[..., None].astype(np.float32))[..., 0]
        squared = equations.squared - ((2 * equations.gradients - less.sum(0)) * last).sum(1)
        inverse = np.asarray(
            np.linalg.inv(equations.normals + LEAST * np.eye(len(PARAMETERS))), np.float64
        )
        places = by_distances(self.parameters)
        grown = max(inflation(normals, gradients - less, inverse, places), LEAST_NOISE**2)
        pixels = np.maximum(_by_corner(self._patches.used.sum(1)), 1)
        misfit = np.sqrt(np.maximum(squared, 0) / pixels) / np.maximum(
            np.abs(self.parameters[:, CONTRAST]), 1e-6
        )
        return Fit(
            self.parameters,
            places @ inverse[:, PLACE, PLACE] @ places.swapaxes(1, 2),
            grown,
            misfit,
            heights,
        )


def _start(patches: Patches, lattice: Lattice) -> Floats:
    crossed = (
        patches.forms[4] * patches.used
    )  # u v: the further from both edges, the less a blur counts
    pixels, shade, pattern, weight, shown = (
        _by_corner(part.sum(1))
        for part in (
            patches.used,
            patches.light * patches.used,
            crossed,
            np.abs(crossed),
            patches.light * crossed,
        )
    )
    parameters = np.zeros((len(pixels), len(PARAMETERS)))
    parameters[:, ANGLES] = lattice.angles
    parameters[:, BLURS] = np.log(BLUR)
    parameters[:, MIDDLE] = shade / np.maximum(pixels, 1)
    parameters[:, CONTRAST] = (parameters[:, MIDDLE] * pattern - shown) / np.maximum(weight, 1e-6)
    return parameters


def _by_corner(rows: NDArray[np.float32]) -> Floats:
    """(N,) sums, of (2N,)."""
    return np.asarray(rows.reshape(2, -1).sum(0), np.float64)
