"""How uneven and how smooth the glass is likely to be: its figure is left free, its texture is a
Gaussian process.

The figure, polynomials of the patch, is what makes a lens of the glass (focus, astigmatism, coma
and their higher orders): no glass is shaped at random there, so a prior that shrinks it spoils what
lies nearer than the trained depths, and one that ends at some degree lets what is cut off pass for
a lens, and the sigmas for too small. So it is free up to the fourth degree and falls off from
there. The texture is what is finer. How high and how long its bumps are is chosen by evidence: a
weak prior would leave them free to take up noise.

Source: D. J. C. MacKay, Bayesian interpolation (1992), for the evidence; C. E. Rasmussen, C. K. I.
    Williams, Gaussian processes for
machine learning (2006), sections 2.7 and 4.2.1, for free polynomials beside a squared exponential.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import minimize

from calib.optics.relief import Relief
from calib.session.glass import Glass, polynomial_degrees

Array = NDArray[np.float64]

FIGURE_DEGREE = 10
FIGURE_FREE = 4
"""The highest degree that is free."""
FIGURE_FALL = 0.2
"""From one degree above that to the next."""
FIGURE_HEIGHT = 3e-4
"""m: standard deviation of a free Legendre polynomial's coefficient, thirty times what glass does
(`GLASS_FIGURE`), so that it is free: with a fifteenth of it, or chosen by evidence down to there,
maps through 60 um of figure were off by 1.35 times their sigma, with a third by 0.99, with this by
0.90 (twelve sessions, every number held).
"""
LEAST_HEIGHT = 1e-9
"""m: what is left independent from centre to centre, so that the covariance can be inverted."""
SIGMA_BOUNDS = (1e-4, 1e2)
"""px"""
HEIGHT_BOUNDS = (1e-9, 3e-3)
"""m"""
LENGTH_BOUNDS = (0.08, 3.0)
"""Of the patch."""
HEIGHTS = (1e-7, 1e-6, 1e-5)
LENGTHS = (0.15, 0.5)
"""Where the search looks before it starts."""


@dataclass(frozen=True, slots=True)
class Smoothness:
    """The texture's heights are normal, and correlated over a length."""

    height: float
    """m: standard deviation."""
    length: float
    """The correlation exp(-d^2 / (2 length^2)), d measured with the patch's sides as one."""

    def precision(self, relief: Relief) -> Array:
        """(n, n) inverse covariance of the amplitudes, row by row, that gives the heights at the
        centres this distribution.
        """
        root = solve_triangular(self.root(relief), basis(relief), lower=True)
        precision: Array = root.T @ root
        return precision

    def root(self, relief: Relief, glass: Glass | None = None) -> Array:
        """(n, n) m, the lower Cholesky factor of the covariance of the heights at the centres.

        Args: glass: a figure that is known.
        """
        root: Array = cholesky(self.covariance(relief, glass), lower=True)
        return root

    def covariance(self, relief: Relief, glass: Glass | None = None) -> Array:
        """(n, n) m^2, of the heights at the centres."""
        axes = [np.linspace(-1, 1, n) for n in relief.grid]
        one, two = (
            np.exp(-((c[:, None] - c) ** 2) / (8 * self.length**2)) for c in axes
        )  # a side is 2 long here
        texture = self.height**2 * np.kron(one, two) + LEAST_HEIGHT**2 * np.eye(len(one) * len(two))
        if not glass:
            return np.asarray(texture + figure(relief.grid))
        known = waves(relief, glass.low, glass.high, glass.degree)
        return np.asarray(
            texture + figure(relief.grid, glass.degree) + known @ glass.covariance @ known.T
        )


@lru_cache(maxsize=8)
def figure(grid: tuple[int, int], beyond: int = -1) -> Array:
    """(n, n) m^2, the covariance of the figure's heights at the centres, by what is `beyond` a
    degree. Not to be written to.
    """
    first, second = (
        legvander(np.linspace(-1, 1, n), FIGURE_DEGREE) for n in grid
    )  # (n, degree + 1)
    those = [(i, k) for i, k in polynomial_degrees(FIGURE_DEGREE) if i + k > beyond]
    heights = np.array(
        [figure_height(i + k) * np.kron(first[:, i], second[:, k]) for i, k in those]
    )
    covariance: Array = heights.T @ heights
    return covariance


def waves(
    relief: Relief, low: tuple[float, float], high: tuple[float, float], degree: int
) -> Array:
    """(n, N) heights at the centres by the coefficients of a figure over a patch."""
    centres = [
        np.linspace(one, two, n)
        for one, two, n in zip(relief.low, relief.high, relief.grid, strict=True)
    ]
    within = [(2 * c - a - b) / (b - a) for c, a, b in zip(centres, low, high, strict=True)]
    first, second = (legvander(c, degree) for c in within)
    return np.stack(
        [np.kron(first[:, i], second[:, k]) for i, k in polynomial_degrees(degree)], axis=1
    )


def expected_amplitudes(relief: Relief, glass: Glass | None) -> Array:
    """(rows, columns) m, of the mean of the relief's prior."""
    if not glass:
        return np.zeros(relief.grid)
    heights = waves(relief, glass.low, glass.high, glass.degree) @ glass.mean
    return np.asarray(np.linalg.solve(basis(relief), heights).reshape(relief.grid))


def figure_height(degree: int) -> float:
    """m: standard deviation of the coefficient of a polynomial of this degree, both directions
    together.
    """
    return FIGURE_HEIGHT * FIGURE_FALL ** max(0, degree - FIGURE_FREE)


def basis(relief: Relief) -> Array:
    """(n, n) heights at the centres by the amplitudes."""
    one, two = (
        np.exp(-((np.arange(n)[:, None] - np.arange(n)) ** 2) / (2 * relief.beta))
        for n in relief.grid
    )
    return np.asarray(np.kron(one, two), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Quadratic:
    """The sum of squares by the shared parameters x, poses adapted: cost(x) = cost - 2 score^T x +
    x^T hessian x, in px^2.
    """

    hessian: Array
    """(S, S)"""
    score: Array
    """(S,) minus half the gradient at x = 0: the residual's component along each parameter."""
    cost: float
    """px^2, at x = 0."""
    freedom: int
    """Residuals less the parameters of the poses."""

    @staticmethod
    def around(
        hessian: Array, gradient: Array, square: float, freedom: int, shared: Array
    ) -> "Quadratic":
        """From the (S, S) Hessian, the (S,) gradient and the sum of squares at (S,) parameters."""
        turned = hessian @ shared
        return Quadratic(
            hessian,
            turned - gradient,
            square - 2 * float(gradient @ shared) + float(shared @ turned),
            freedom,
        )


class MarginalLikelihood:
    """The probability of the corners, the shared parameters integrated out, for any noise and
    smoothness: the evidence.
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
            quadratic: of the amplitudes, then the free parameters over their scales.
            relief: whose amplitudes are estimated; None without one.
            free_root: (F, F) R with R R^T the prior covariance of the free parameters, over their
                scales.
            joint_root: (S, S) the same of the heights at the centres and the free parameters, where
                these are not independent.
        """
        self._relief, self._freedom, self._cost = relief, quadratic.freedom, quadratic.cost
        amplitudes = len(quadratic.score) - len(free_root)
        to_x = np.eye(len(quadratic.score))
        self._joint_root = joint_root
        if not joint_root:
            to_x[amplitudes:, amplitudes:] = free_root  # free parameters, whitened by their prior
        if relief:
            to_x[:amplitudes, :amplitudes] = np.linalg.inv(basis(relief))  # heights at the centres
        self._hessian, self._score = to_x.T @ quadratic.hessian @ to_x, to_x.T @ quadratic.score

    def log(self, sigma: float, smoothness: Smoothness | None) -> float:
        """The logarithm, up to a constant; -infinity where it cannot be computed.

        With heights = root z, z standard normal, everything is a correction to the identity: no
        prior is ever inverted.
        """
        root = np.eye(len(self._score))
        try:
            if self._joint_root and smoothness:
                root = self._joint_root(smoothness)
            elif self._relief and smoothness:
                heights = self._relief.grid[0] * self._relief.grid[1]
                root[:heights, :heights] = smoothness.root(self._relief)
            posterior = np.eye(len(root)) + root.T @ self._hessian @ root / sigma**2
            factor = cholesky(posterior, lower=True)
        except LinAlgError:
            return -np.inf
        explained = solve_triangular(factor, root.T @ self._score / sigma**2, lower=True)
        least = self._cost / sigma**2 - float(explained @ explained)
        return float(-np.log(factor.diagonal()).sum() - 0.5 * least - self._freedom * np.log(sigma))


def most_probable(
    evidence: MarginalLikelihood, sigma: float, start: Smoothness | None
) -> tuple[float, Smoothness | None]:
    """The noise (px, per axis) and the smoothness with the largest evidence; no smoothness without
    a relief.

    The search begins at the best of a start and a few others.
    """
    if start:  # the evidence has several tops
        start = max(
            (start, *(Smoothness(height, length) for height in HEIGHTS for length in LENGTHS)),
            key=lambda s: evidence.log(sigma, s),
        )
    begin = [sigma, start.height, start.length] if start else [sigma]
    bounds = [SIGMA_BOUNDS, HEIGHT_BOUNDS, LENGTH_BOUNDS][: len(begin)]

    def badness(logs: Array) -> float:
        noise, *rest = np.exp(logs).tolist()
        return -max(evidence.log(noise, Smoothness(*rest) if rest else None), -1e300)

    limits = [(float(np.log(low)), float(np.log(high))) for low, high in bounds]
    found = minimize(
        badness,
        np.clip(np.log(begin), *np.transpose(limits)),
        bounds=limits,
        method="Nelder-Mead",
        options={"xatol": 0.01, "fatol": 0.01},
    )
    sigma, *rest = np.exp(found.x).tolist()
    return sigma, Smoothness(*rest) if rest else None
