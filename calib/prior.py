"""How uneven and how smooth the glass is likely to be: a Gaussian process whose height and length are chosen by evidence.

The strength of this prior decides what a calibration says beyond the depths that it was trained on, where a weak prior leaves the relief
free to take up noise.

Source: D. J. C. MacKay, Bayesian interpolation (1992), for the evidence; C. E. Rasmussen, C. K. I. Williams, Gaussian processes for
machine learning (2006), section 4.2.1, for the squared exponential.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize
from torch import Tensor

from calib.optics.relief import Relief

JITTER = 1e-5
"""Of the height's variance: what is left independent from centre to centre, so that the covariance can be inverted."""
SIGMA_BOUNDS = (1e-4, 1e2)
"""px"""
HEIGHT_BOUNDS = (1e-9, 3e-3)
"""m"""
LENGTH_BOUNDS = (0.08, 3.0)
"""Of the patch."""


@dataclass(frozen=True, slots=True)
class Smoothness:
    """The relief's heights are normal, and correlated over a length."""

    height: float
    """m: standard deviation."""
    length: float
    """The correlation exp(-d^2 / (2 length^2)), d measured with the patch's sides as one."""

    def precision(self, relief: Relief) -> Tensor:
        """(n, n) inverse covariance of the amplitudes, row by row, that gives the heights at the centres this distribution."""
        basis = _basis(relief)
        precision: Tensor = basis.mT @ torch.linalg.inv(self._covariance(relief)) @ basis
        return precision

    def log_det_precision(self, relief: Relief) -> float:
        return float(2 * torch.linalg.slogdet(_basis(relief)).logabsdet - torch.linalg.slogdet(self._covariance(relief)).logabsdet)

    def _covariance(self, relief: Relief) -> Tensor:
        """(n, n) m^2, of the heights at the centres."""
        rows, columns = (torch.linspace(0, 1, n, dtype=torch.float64) for n in relief.grid)
        at = torch.cartesian_prod(rows, columns)
        away2 = ((at.unsqueeze(1) - at) ** 2).sum(-1)
        return self.height**2 * (torch.exp(-away2 / (2 * self.length**2)) + JITTER * torch.eye(len(at), dtype=torch.float64))


@dataclass(frozen=True, slots=True)
class Rows:
    """What the corners say of the shared numbers near a fit, poses adapted, for corners of one pixel's standard deviation."""

    curvature: Tensor
    """(S, S)"""
    slope: Tensor
    """(S,)"""
    cost: float
    """px^2, the sum of squared errors."""
    freedom: int
    """Residuals less the numbers of the poses."""


def most_probable(
    rows: Rows, shared: Tensor, relief: Relief | None, start: Smoothness | None, fixed: Tensor
) -> tuple[float, Smoothness | None]:
    """The noise (px, per axis) and the smoothness with the largest evidence.

    Args:
        rows: the quadratic that the corners leave around `shared`.
        shared: (S,) amplitudes, then the free numbers.
        start: where the search begins; None without a relief.
        fixed: (F,) precision of the free numbers.
    """
    scale = [(rows.cost / rows.freedom) ** 0.5]
    bounds = [SIGMA_BOUNDS]
    if start:
        scale += [start.height, start.length]
        bounds += [HEIGHT_BOUNDS, LENGTH_BOUNDS]

    def badness(logs: np.ndarray) -> float:
        sigma, *rest = np.exp(logs)
        return -log_evidence(rows, shared, relief, float(sigma), Smoothness(*map(float, rest)) if rest else None, fixed)

    limits = [(float(np.log(low)), float(np.log(high))) for low, high in bounds]
    begin = np.clip(np.log(np.maximum(scale, 1e-300)), *np.transpose(limits))
    found = minimize(badness, begin, bounds=limits, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 0.01})
    sigma, *rest = (float(value) for value in np.exp(found.x))
    return sigma, Smoothness(*rest) if rest else None


def log_evidence(rows: Rows, shared: Tensor, relief: Relief | None, sigma: float, smoothness: Smoothness | None, fixed: Tensor) -> float:
    """The logarithm of the probability of the corners, amplitudes and free numbers integrated out, up to a constant."""
    precision, log_det = torch.zeros(len(shared), len(shared), dtype=torch.float64), 0.0
    count = len(shared) - len(fixed)
    precision[count:, count:] = torch.diag(fixed)
    if relief and smoothness:
        precision[:count, :count] = smoothness.precision(relief)
        log_det = smoothness.log_det_precision(relief)
    posterior = rows.curvature / sigma**2 + precision
    pull = rows.slope / sigma**2 + precision @ shared
    factor, failed = torch.linalg.cholesky_ex(posterior)
    if bool(failed):
        return -1e300
    solved = torch.cholesky_solve(pull.unsqueeze(-1), factor).squeeze(-1)
    least = rows.cost / sigma**2 + float(shared @ precision @ shared - pull @ solved)
    return float(0.5 * (log_det - least - rows.freedom * np.log(sigma**2)) - float(factor.diagonal().log().sum()))


def _basis(relief: Relief) -> Tensor:
    """(n, n) heights at the centres by the amplitudes."""
    one, two = (
        torch.exp(-((torch.arange(n, dtype=torch.float64).unsqueeze(1) - torch.arange(n)) ** 2) / (2 * relief.beta)) for n in relief.grid
    )
    return torch.kron(one, two)
