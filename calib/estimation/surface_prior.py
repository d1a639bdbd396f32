"""The prior of the glass's relief: a figure plus a texture that is a Gaussian process.

The figure, a polynomial over the patch, makes a lens of the glass (focus, astigmatism, coma and
their higher orders). Its standard deviations are those of moulded glass, and fall off with the
degree. They do not end at some degree: the missing degrees would pass for a lens and make the
sigmas too small. The texture is everything finer. The evidence chooses the height and the length of
its bumps: a weak prior would let them fit noise.

The prior describes the heights at points that form a grid over the relief's region, as many as
there are centres. The centres reach farther: see `calib.optics.relief.INSET`.

Source: D. J. C. MacKay, Bayesian interpolation (1992), for the evidence; C. E. Rasmussen, C. K. I.
Williams, Gaussian processes for machine learning (2006), sections 2.7 and 4.2.1, for free
polynomials beside a squared exponential.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from calib.optics.relief import Relief, inset_of
from calib.session.glass import Glass, polynomial_degrees

Array = NDArray[np.float64]

FIGURE_DEGREE = 10
FIGURE_LEVEL = 1e-4
"""m: the standard deviation of the height's mean, which is thickness."""
FIGURE_HEIGHT = 3e-5
"""m: the standard deviation of the coefficient of a Legendre polynomial of the first or second
degree, three times what cheap windows have over a centimetre (`GLASS_FIGURE`).
"""
FIGURE_FALL = 0.4
"""The factor of the standard deviation from one degree above the second to the next."""
MIN_HEIGHT = 1e-9
"""m: the standard deviation of an independent part at each centre, so that the covariance can be
inverted.
"""
SIGMA_BOUNDS = (1e-4, 1e2)
"""px"""
HEIGHT_BOUNDS = (1e-9, 6e-5)
"""m"""
LENGTH_BOUNDS = (0.08, 3.0)
"""In units of the patch's side."""
TOLERANCE = 0.01
"""Of the logarithms of the noise and of the texture, and of the log evidence."""
START_HEIGHTS = (1e-7, 1e-6, 1e-5)
START_LENGTHS = (0.15, 0.5)
"""The heights (m) and lengths (of the patch) among which the search chooses its start."""


@dataclass(frozen=True, slots=True)
class Smoothness:
    """The parameters of the texture, a Gaussian process of heights."""

    height: float
    """m: the standard deviation."""
    length: float
    """The correlation is exp(-d^2 / (2 length^2)) at a distance d, with the sides of the relief's
    region as one.
    """
    figure: float = 1.0
    """The factor of the figure's standard deviations. Even glass has neither figure nor texture."""

    def precision(self, relief: Relief) -> Array:
        """Return the (n, n) inverse prior covariance of the amplitudes, row by row, for which the
        heights at the prior's points have this distribution.
        """
        root = solve_triangular(self.root(relief), relief_basis(relief), lower=True)
        precision: Array = root.T @ root
        return precision

    def root(self, relief: Relief, glass: Glass | None = None) -> Array:
        """Return the (n, n) m lower Cholesky factor of the covariance of the heights at the prior's
        points.

        Args:
            glass: the prior of the figure, if there is one.
        """
        root: Array = cholesky(self.covariance(relief, glass), lower=True)
        return root

    def covariance(self, relief: Relief, glass: Glass | None = None) -> Array:
        """Return the (n, n) m^2 covariance of the heights at the prior's points."""
        first = self._correlation(relief.grid[0])
        second = self._correlation(relief.grid[1])
        count = len(first) * len(second)
        correlation = first[:, None, :, None] * second[:, None]  # faster than numpy's kron
        texture = self.height**2 * correlation.reshape(count, count)
        np.fill_diagonal(texture, texture.diagonal() + MIN_HEIGHT**2)
        if not glass:
            return np.asarray(texture + self.figure**2 * figure_covariance(relief.grid))
        to_heights = figure_heights(relief, glass.low, glass.high, glass.degree)
        return np.asarray(
            texture
            + figure_covariance(relief.grid, glass.degree)
            + to_heights @ glass.covariance @ to_heights.T
        )

    def _correlation(self, count: int) -> Array:
        """Return the (count, count) correlations of a row of points; a side is 2 long here."""
        points = np.linspace(-1, 1, count)
        distance = points[:, None] - points
        return np.asarray(np.exp(-(distance**2) / (8 * self.length**2)))


@lru_cache(maxsize=8)
def figure_covariance(grid: tuple[int, int], degree: int = -1) -> Array:
    """Return the (n, n) m^2 covariance of the figure's heights at the prior's points, from the
    polynomials above a degree. The array is shared; do not write to it.
    """
    rows, columns = grid
    first = legvander(np.linspace(-1, 1, rows), FIGURE_DEGREE)  # (rows, degree + 1)
    second = legvander(np.linspace(-1, 1, columns), FIGURE_DEGREE)
    heights = np.array(
        [
            figure_height(i + k) * np.kron(first[:, i], second[:, k])
            for i, k in polynomial_degrees(FIGURE_DEGREE)
            if i + k > degree
        ]
    )
    covariance: Array = heights.T @ heights
    return covariance


def figure_heights(
    relief: Relief, low: tuple[float, float], high: tuple[float, float], degree: int
) -> Array:
    """Return the (n, N) matrix from the coefficients of a figure over a patch to the heights at the
    prior's points.
    """
    rows, columns = relief.grid
    (first_low, second_low), (first_high, second_high) = relief.region
    first_points = np.linspace(first_low, first_high, rows)
    second_points = np.linspace(second_low, second_high, columns)
    first = legvander((2 * first_points - low[0] - high[0]) / (high[0] - low[0]), degree)
    second = legvander((2 * second_points - low[1] - high[1]) / (high[1] - low[1]), degree)
    return np.stack(
        [np.kron(first[:, i], second[:, k]) for i, k in polynomial_degrees(degree)], axis=1
    )


def expected_amplitudes(relief: Relief, glass: Glass | None) -> Array:
    """Return the (rows, columns) m amplitudes of the mean of the relief's prior."""
    if not glass:
        return np.zeros(relief.grid)
    heights = figure_heights(relief, glass.low, glass.high, glass.degree) @ glass.mean
    return np.asarray(np.linalg.solve(relief_basis(relief), heights).reshape(relief.grid))


def figure_height(degree: int) -> float:
    """Return the prior standard deviation, m, of the coefficient of a polynomial of this total
    degree.
    """
    return FIGURE_HEIGHT * FIGURE_FALL ** max(0, degree - 2) if degree else FIGURE_LEVEL


def relief_basis(relief: Relief) -> Array:
    """Return the (n, n) matrix from the amplitudes to the heights at the prior's points."""
    first = _bells(relief.grid[0], relief)
    second = _bells(relief.grid[1], relief)
    return np.asarray(np.kron(first, second), dtype=np.float64)


def _bells(count: int, relief: Relief) -> Array:
    """Return (points, centres), the Gaussians of one axis at the points of the prior."""
    centres = np.arange(count) - (count - 1) / 2
    points = (1 - inset_of(count, relief.inset)) * centres
    return np.asarray(np.exp(-((points[:, None] - centres) ** 2) / (2 * relief.beta)))


@dataclass(frozen=True, slots=True)
class Quadratic:
    """The sum of squares as a function of the shared parameters x, with the poses eliminated:
    cost(x) = cost - 2 score^T x + x^T hessian x, in px^2.
    """

    hessian: Array
    """(S, S)"""
    score: Array
    """(S,) minus half the gradient at x = 0: the residual's component along each parameter."""
    cost: float
    """px^2, at x = 0."""
    freedom: int
    """The number of residuals minus that of the view parameters."""

    @staticmethod
    def around(
        hessian: Array, gradient: Array, square: float, freedom: int, shared: Array
    ) -> "Quadratic":
        """Return the quadratic with the (S, S) Hessian, the (S,) gradient and the sum of squares at
        (S,) shared parameters.
        """
        product = hessian @ shared
        return Quadratic(
            hessian,
            product - gradient,
            square - 2 * float(gradient @ shared) + float(shared @ product),
            freedom,
        )


class MarginalLikelihood:
    """The evidence: the probability of the corners for any noise and smoothness, with the shared
    parameters integrated out.
    """

    def __init__(
        self,
        quadratic: Quadratic,
        relief: Relief | None,
        free_root: Array,
        joint_root: Callable[[Smoothness], Array] | None = None,
    ) -> None:
        """
        Args:
            quadratic: the quadratic in the amplitudes, then the free parameters over their scales.
            relief: the relief whose amplitudes are estimated; None without one.
            free_root: (F, F) R with R R^T the prior covariance of the free parameters, over their
                scales.
            joint_root: a function that returns the (S, S) root of the joint prior covariance of the
                heights at the prior's points and the free parameters, if these are not independent.
        """
        self._relief, self._freedom, self._cost = relief, quadratic.freedom, quadratic.cost
        amplitudes = len(quadratic.score) - len(free_root)
        to_x = np.eye(len(quadratic.score))
        self._joint_root = joint_root
        if not joint_root:
            to_x[amplitudes:, amplitudes:] = free_root  # free parameters, whitened by their prior
        if relief:
            to_x[:amplitudes, :amplitudes] = np.linalg.inv(
                relief_basis(relief)
            )  # heights at the prior's points
        self._hessian, self._score = to_x.T @ quadratic.hessian @ to_x, to_x.T @ quadratic.score

    def log(self, sigma: float, smoothness: Smoothness | None) -> float:
        """Return the logarithm of the evidence, up to a constant; -infinity if it cannot be
        computed.

        With heights = root z, z standard normal, everything is a correction to the identity, so no
        prior is ever inverted.
        """
        posterior, score = self._hessian.copy(), self._score.copy()
        try:
            if smoothness and (root := self._root(smoothness)) is not None:
                size = len(root)
                posterior[:size, :size] = root.T @ posterior[:size, :size] @ root
                posterior[size:, :size] = posterior[size:, :size] @ root
                score[:size] = root.T @ score[:size]
            posterior /= sigma**2
            np.fill_diagonal(posterior, 1 + posterior.diagonal())
            factor = cholesky(posterior, lower=True)  # takes the lower triangle
        except LinAlgError:
            return -np.inf
        explained = solve_triangular(factor, score / sigma**2, lower=True)
        minimum = self._cost / sigma**2 - float(explained @ explained)
        log_determinant = np.log(factor.diagonal()).sum()
        return float(-log_determinant - 0.5 * minimum - self._freedom * np.log(sigma))

    def _root(self, smoothness: Smoothness) -> Array | None:
        """Return the root of the prior covariance of the heights, or of all parameters if these are
        not independent; None without a relief.
        """
        if self._joint_root:
            return self._joint_root(smoothness)
        return smoothness.root(self._relief) if self._relief else None


def maximise_evidence(
    evidence: MarginalLikelihood,
    sigma: float,
    start: Smoothness | None,
    *,
    fixed_noise: bool = False,
) -> tuple[float, Smoothness | None]:
    """Return the noise (px, per axis) and the smoothness with the largest evidence; no smoothness
    without a relief.

    The search starts at the best of `start` and a few other points.

    Args:
        fixed_noise: True to return the noise as it is given.
    """
    from scipy.optimize import minimize  # commands that fit nothing do without it

    if start:  # the evidence has several maxima
        start = max(
            (
                start,
                *(
                    replace(start, height=height, length=length)
                    for height in START_HEIGHTS
                    for length in START_LENGTHS
                ),
            ),
            key=lambda s: evidence.log(sigma, s),
        )
    initial = [sigma, start.height, start.length] if start else [sigma]
    bounds = [SIGMA_BOUNDS, HEIGHT_BOUNDS, LENGTH_BOUNDS][: len(initial)]

    def parts(logs: Array) -> tuple[float, Smoothness | None]:
        noise, *texture = np.exp(logs).tolist()
        if not start:
            return noise, None
        height, length = texture
        return noise, replace(start, height=height, length=length)

    def badness(logs: Array) -> float:
        return -max(evidence.log(*parts(logs)), -1e300)

    low, high = np.log(bounds).T
    if fixed_noise:
        low[0] = high[0] = np.log(sigma)
    result = minimize(
        badness,
        np.log(initial).clip(low, high),
        bounds=list(zip(low, high, strict=True)),
        method="Nelder-Mead",
        options={"xatol": TOLERANCE, "fatol": TOLERANCE},
    )
    return parts(result.x)
