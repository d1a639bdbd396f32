"""Measure corners by maximum likelihood: fit the patch model to the pixels, and derive the
uncertainty from their noise.
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
    ExpectedPatches,
    place_per_distance,
)
from calib.corners.patch_noise import noise_inflation, split_chunks
from calib.corners.patches import Patches, sample_patches
from calib.session.board import Board

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

HALF_WIDTHS = (3, 5, 9)  # px on both sides of an edge: the first one that holds the blur is used
# places along an edge at which pixels are taken: at least COARSE_PLACES to come near, then
# MAX_PLACES, which are all but for the largest squares
COARSE_PLACES = 14
MAX_PLACES = 96
MAX_BLUR_FRACTION = 0.33  # of a half-width: the largest blur that it can hold
BLUR = 0.8  # px, the initial value
BLUR_LIMITS = (np.log(0.3), np.log(6.0))  # of px
# bounds of parameters; a step that would leave them ends at them
LIMITS = {
    FIRST_BLUR: BLUR_LIMITS,
    SECOND_BLUR: BLUR_LIMITS,
    HALO_STRENGTH: (0.0, np.inf),
}
MAX_ITERATIONS = 10
# A corner has converged if its step is below all of these:
PLACE_TOLERANCE = 0.03  # px: the next step would be about its square over the blur
SHAPE_TOLERANCE = 0.3  # of the logarithms of blurs, and of the halo
GAIN_TOLERANCE = 0.5  # of the squared residuals
# where more than this part of a corner's pixels is saturated, its tolerances are multiplied by the
# next number
SATURATED_FRACTION = 0.1
SATURATED_TOLERANCE = 0.1
DAMPING = 1e-3
OUTLIER_THRESHOLD = 3.0  # standard deviations of a pixel's noise, from which on its weight falls
MIN_NOISE = 0.29  # grey levels: that of rounding
REGULARISATION = 1e-6  # of a normal matrix: a parameter that no pixel constrains does not move
NOISE_STRIDE = 3  # every third pixel contributes to the noise estimate
MAD_TO_SIGMA = 1.4826  # a Gaussian's standard deviation over its median absolute deviation


@dataclass(frozen=True, slots=True, eq=False)
class PatchFit:
    """The fitted parameters of N patches."""

    parameters: Floats
    """(N, 11), as in `PARAMETERS`."""
    unit_covariances: Floats
    """(N, 2, 2) px^2 of the place, for independent pixel noise of one grey level."""
    noise_inflation: float
    """Grey levels^2: the factor for `unit_covariances` that the picture's own noise gives."""
    misfit: Floats
    """(N,) the root mean square of the residuals over the contrast."""
    heights: Floats
    """(N, 2 edges) px, those of the lattice."""


def fit_patches(
    grey: NDArray, corners: Floats, board: Board, lattice: Lattice | None = None
) -> PatchFit:
    """Fit the patch of every corner that is not NaN.

    Args:
        grey: (H, W) uint8 or uint16.
        corners: (count, 2) px, a regular grid, each wrong by less than a blur. Some may be NaN.
        board: its columns and rows.
        lattice: the lattice of the corners that are not NaN. None: it is taken from the corners,
            before the fit and again near its end.
    """
    given_lattice = lattice
    lattice = lattice or Lattice.from_corners(corners, board)
    brightest = float(np.iinfo(grey.dtype).max)
    coarse: _Descent | None = None
    for half_width in HALF_WIDTHS:
        patches = sample_patches(grey, lattice, half_width, MAX_PLACES)
        thinned = patches.thinned(COARSE_PLACES)
        start = coarse.parameters if coarse else _start(thinned, lattice)
        all_places = [slice(0, len(thinned.places))]
        coarse = _Descent(thinned, lattice.curvatures, brightest, start, all_places)
        if np.exp(np.median(coarse.parameters[:, BLURS])) <= MAX_BLUR_FRACTION * half_width:
            break
    assert coarse is not None
    curvatures = lattice.curvatures
    if not given_lattice:
        moved = corners.copy()
        moved[np.isfinite(corners[:, 0])] += coarse.parameters[:, PLACE]
        curvatures = Lattice.from_corners(moved, board).curvatures
    chunks = split_chunks(len(patches.places), edges=2)
    descent = _Descent(patches, curvatures, brightest, coarse.parameters, chunks)
    return descent.result(lattice.heights)


@dataclass(frozen=True, slots=True, eq=False)
class _CornerEquations:
    """The normal equations of N corners, whose pixels are summed in C chunks.

    In place of x and y, they have the px across each edge.
    """

    by_chunk: NDArray[np.float32]
    """(C, N, 11, 12) normal matrices, with the gradients as their last columns."""
    normals: Floats
    """(N, 11, 11) sums over all pixels."""
    gradients: Floats
    """(N, 11)"""
    squared: Floats
    """(N,) grey levels^2, the sums of all squared residuals."""

    @staticmethod
    def from_chunks(by_chunk: NDArray[np.float32], squared: Floats) -> "_CornerEquations":
        total = by_chunk.sum(0, dtype=np.float64)
        return _CornerEquations(by_chunk, total[..., :-1], total[..., -1], squared)

    def step(self, parameters: Floats, damping: Floats) -> Floats:
        """Return the (N, 11) step from these parameters, with (N,) dampings."""
        normal, gradient = self.normals.copy(), self.gradients.copy()
        for index, (lower, upper) in LIMITS.items():
            value, slope = parameters[:, index], gradient[:, index]
            stopped = ((value <= lower) & (slope <= 0)) | ((value >= upper) & (slope >= 0))
            normal[stopped, index], normal[stopped, :, index], gradient[stopped, index] = 0, 0, 0
        diagonal = np.einsum("nkk->nk", normal)
        diagonal *= 1 + damping[:, None]
        diagonal += REGULARISATION
        return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0])

    def replace(self, corners: Indices, equations: "_CornerEquations") -> None:
        """Replace the equations of the corners at these indices."""
        self.by_chunk[:, corners] = equations.by_chunk
        self.normals[corners] = equations.normals
        self.gradients[corners] = equations.gradients
        self.squared[corners] = equations.squared


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """The patches of N corners beside the model's prediction."""

    patches: Patches
    expected: ExpectedPatches
    residuals: NDArray[np.float32]
    """(2N, P) grey levels, 0 where no pixel is used."""
    informative: NDArray[np.float32]
    """(2N, P) 1, or 0 where no pixel is used, or where the prediction lies outside the sensor's
    range.
    """

    @staticmethod
    def evaluate(
        parameters: Floats, patches: Patches, curvatures: Floats, brightest: float
    ) -> "_Comparison":
        second = parameters[:, SECOND_FIRST]
        second[:, PLACE] = parameters[:, PLACE]
        expected = ExpectedPatches.predict(
            np.concatenate([parameters, second]),
            patches,
            np.concatenate([curvatures, curvatures[:, ::-1]]),
        )
        light = expected.light
        informative = patches.used
        if light.min() <= 0 or light.max() >= brightest:
            informative = informative * ((light > 0) & (light < brightest))
            light = np.clip(light, 0, brightest)
        residuals = patches.light - light
        residuals *= patches.used
        return _Comparison(patches, expected, residuals, informative)

    def noise(self) -> float:
        """Return the noise of the bulk of the informative pixels, grey levels."""
        informative = self.informative[:, ::NOISE_STRIDE]
        size = np.abs(self.residuals[:, ::NOISE_STRIDE] * informative).ravel()
        middle = size.size - 1 - np.count_nonzero(informative) // 2  # the others are 0
        return max(MAD_TO_SIGMA * float(np.partition(size, middle)[middle]), MIN_NOISE)

    def tolerance_factor(self) -> Floats:
        """Return (N,) 1, or less where many pixels are saturated: the parameters decide which
        pixels are informative there, so a short step is no sign of convergence.
        """
        if self.informative is self.patches.used:
            return np.ones(len(self.informative) // 2)
        used = _by_corner(self.patches.used.sum(1))
        saturated = _by_corner(self.informative.sum(1)) < (1 - SATURATED_FRACTION) * used
        return np.where(saturated, SATURATED_TOLERANCE, 1.0)

    def cost(self, threshold: float) -> Floats:
        """Return the (N,) Huber costs."""
        size = np.abs(self.residuals) * np.float32(1 / threshold)
        bulk = np.minimum(size, 1)
        return _by_corner((bulk * (2 * size - bulk)).sum(1))

    def equations(self, threshold: float, chunks: list[slice]) -> _CornerEquations:
        """Return the normal equations.

        Args:
            threshold: grey levels; larger residuals weigh less.
            chunks: the places along an edge that are summed together.
        """
        corners = len(self.residuals) // 2
        pixels_across = self.patches.pixels_across
        pieces = [
            slice(chunk.start * pixels_across, chunk.stop * pixels_across) for chunk in chunks
        ]
        rows = np.empty((len(PARAMETERS) + 1, corners, self.residuals.shape[1]), np.float32)
        columns = rows.swapaxes(0, 1)
        sums = np.empty((2, len(pieces), corners, len(PARAMETERS), len(rows)), np.float32)
        for edge, edge_rows in enumerate((slice(corners), slice(corners, None))):
            roots = np.abs(self.residuals[edge_rows])  # of the weights
            np.maximum(roots, np.float32(threshold), out=roots)
            np.divide(np.float32(threshold), roots, out=roots)
            np.sqrt(roots, out=roots)
            roots *= self.informative[edge_rows]
            np.multiply(roots, self.residuals[edge_rows], out=rows[-1])
            self.expected.select(edge_rows).derivatives(
                roots, [rows[index] for index in SECOND_FIRST] if edge else list(rows)
            )
            for index, piece in enumerate(pieces):
                block = columns[..., piece]
                # the two factors have different shapes: a product with itself is slower
                np.matmul(block[:, :-1], block.swapaxes(1, 2), out=sums[edge, index])
        squared = _by_corner(np.einsum("rp,rp->r", self.residuals, self.residuals))
        return _CornerEquations.from_chunks(sums.reshape(-1, *sums.shape[2:]), squared)


class _Descent:
    """Levenberg-Marquardt steps for all corners at once. Each corner has its own damping and stops
    when its steps are short.
    """

    def __init__(
        self,
        patches: Patches,
        curvatures: Floats,
        brightest: float,
        start: Floats,
        chunks: list[slice],
    ) -> None:
        """Fit from the (N, 11) `start`; `chunks` are the places summed together."""
        self.parameters = start
        self._patches = patches
        self._curvatures = curvatures
        self._brightest = brightest
        self._chunks = chunks
        self._run(np.arange(len(start)), start)

    def _run(self, corners: Indices, current: Floats) -> None:
        patches = self._patches
        curvatures = self._curvatures
        damping = np.full(len(current), DAMPING)
        comparison = _Comparison.evaluate(current, patches, curvatures, self._brightest)
        noise = np.inf
        for _ in range(MAX_ITERATIONS):
            noise = min(noise, comparison.noise())
            equations = comparison.equations(OUTLIER_THRESHOLD * noise, self._chunks)
            step = equations.step(current, damping)
            place_step = (place_per_distance(current) @ step[:, PLACE, None])[..., 0]
            candidate = current + np.concatenate([place_step, step[:, 2:]], 1)
            step_size = np.maximum(
                np.abs(place_step).max(1) / PLACE_TOLERANCE,
                np.abs(step[:, list(LIMITS)]).max(1) / SHAPE_TOLERANCE,
            )
            active = step_size >= comparison.tolerance_factor()
            active |= (equations.gradients * step).sum(1) > GAIN_TOLERANCE * equations.squared
            self._store(
                corners,
                np.where(active[:, None], current, candidate),
                np.where(active[:, None], 0, step),
                equations,
            )
            if not active.any():
                return
            cost = comparison.cost(OUTLIER_THRESHOLD * noise)
            if not active.all():
                patches = patches.of_corners(np.flatnonzero(active))
                corners = corners[active]
                current = current[active]
                candidate = candidate[active]
                damping = damping[active]
                cost = cost[active]
                curvatures = curvatures[active]
            for index, limits in LIMITS.items():
                candidate[:, index] = np.clip(candidate[:, index], *limits)
            comparison = _Comparison.evaluate(candidate, patches, curvatures, self._brightest)
            better = comparison.cost(OUTLIER_THRESHOLD * noise) <= cost * (1 + 1e-6)
            damping = np.where(better, damping / 10, damping * 10)
            current = np.where(better[:, None], candidate, current)
            if not better.all():
                comparison = _Comparison.evaluate(current, patches, curvatures, self._brightest)

    def _store(
        self, corners: Indices, parameters: Floats, last_step: Floats, equations: _CornerEquations
    ) -> None:
        """Store these corners' parameters, the step that led to them, and the equations from before
        that step.
        """
        if len(corners) == len(self.parameters):
            self.parameters = parameters
            self._last_step = last_step
            self._equations = equations
        else:
            self.parameters[corners] = parameters
            self._last_step[corners] = last_step
            self._equations.replace(corners, equations)

    def result(self, heights: Floats) -> PatchFit:
        """Return the fit; `heights` are the lattice's, (N, 2 edges) px."""
        equations = self._equations
        last_step = self._last_step
        normals = equations.by_chunk[..., :-1]
        gradients = equations.by_chunk[..., -1]
        gradient_change = (normals @ last_step[..., None].astype(np.float32))[..., 0]
        squared = equations.squared - (
            (2 * equations.gradients - gradient_change.sum(0)) * last_step
        ).sum(1)
        inverse = np.asarray(
            np.linalg.inv(equations.normals + REGULARISATION * np.eye(len(PARAMETERS))), np.float64
        )
        places = place_per_distance(self.parameters)
        inflation = noise_inflation(normals, gradients - gradient_change, inverse, places)
        pixels = np.maximum(_by_corner(self._patches.used.sum(1)), 1)
        misfit = np.sqrt(np.maximum(squared, 0) / pixels) / np.maximum(
            np.abs(self.parameters[:, CONTRAST]), 1e-6
        )
        return PatchFit(
            parameters=self.parameters,
            unit_covariances=places @ inverse[:, PLACE, PLACE] @ places.swapaxes(1, 2),
            noise_inflation=max(inflation, MIN_NOISE**2),
            misfit=misfit,
            heights=heights,
        )


def _start(patches: Patches, lattice: Lattice) -> Floats:
    """Return (N, 11) initial parameters."""
    # u v times the mask: the farther a pixel is from both edges, the less a blur affects it
    crossed = patches.forms[4] * patches.used
    pixels = _by_corner(patches.used.sum(1))
    light = _by_corner((patches.light * patches.used).sum(1))
    pattern = _by_corner(crossed.sum(1))
    weight = _by_corner(np.abs(crossed).sum(1))
    correlation = _by_corner((patches.light * crossed).sum(1))
    parameters = np.zeros((len(pixels), len(PARAMETERS)))
    parameters[:, ANGLES] = lattice.angles
    parameters[:, BLURS] = np.log(BLUR)
    middle = light / np.maximum(pixels, 1)
    parameters[:, MIDDLE] = middle
    parameters[:, CONTRAST] = (middle * pattern - correlation) / np.maximum(weight, 1e-6)
    return parameters


def _by_corner(rows: NDArray[np.float32]) -> Floats:
    """Return the (N,) sums over both edges of (2N,) rows."""
    return np.asarray(rows.reshape(2, -1).sum(0), np.float64)
