"""The joint maximum-likelihood fit: relief amplitudes and any freed numbers together with every view's pose."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import block_diag
from torch import Tensor

from calib.estimation.levenberg_marquardt import Outcome, Solution, minimise
from calib.estimation.objective import LandingProblem, Shared, view_precision
from calib.estimation.observations import Observations
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.estimation.surface_prior import Evidence, Quadratic, Smoothness, most_probable
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.schema import Number

FIRST_SIGMA = 0.1
"""px"""
FIRST_PRIOR = Smoothness(height=1e-5, length=0.4)
ROUNDS = (1e-2, 1e-4, 1e-9)
"""Tolerances of one fit after another; between them the prior, the noise and the pixel weighting are estimated anew."""


AGAIN = (1e-4,)
"""The same of a fit that starts where one like it ended."""


@dataclass(frozen=True, slots=True)
class Start:
    """Where an earlier fit ended."""

    values: Values
    sigma: float
    """px"""
    smoothness: Smoothness | None


@dataclass(frozen=True, slots=True)
class JointFit:
    """Where the joint fit ended."""

    values: dict[str, Tensor]
    poses: Tensor
    """(V, 6)"""
    covariance: Tensor
    """(S, S) of the shared numbers: amplitudes in m, free numbers over their scales. Poses are marginalised. NaN where the outcome is
    NOT_FINITE."""
    sigma: float
    """px: standard deviation of a corner in x and in y, estimated."""
    smoothness: Smoothness | None
    scales: Mapping[str, float]
    """Of the free numbers, in the order of the covariance's last rows."""
    outcome: Outcome
    iterations: int
    """Linearisations, of all rounds together."""

    @property
    def finite(self) -> bool:
        return self.outcome is not Outcome.NOT_FINITE

    @property
    def known_covariance(self) -> np.ndarray:
        """As a calibration keeps it: (0, 0) where it is not known."""
        return self.covariance.numpy() if self.finite else np.zeros((0, 0))

    def estimates(self) -> dict[str, Number]:
        """The free numbers with their standard deviations, in SI units; NaN for those of a fit that is not finite."""
        return {name: Number(float(self.values[name]), float(self.sigma_of(name))) for name in self.scales if not self.values[name].ndim}

    def sigma_of(self, name: str) -> Tensor:
        """The standard deviation of a free number, shaped as it is."""
        value, place = self.values[name], Shared(self.values, None, self.scales).places()[name]
        first = len(self.covariance) - sum(self.values[other].numel() for other in self.scales)
        sigma = self.covariance.diagonal()[first:][place].clamp_min(0.0).sqrt()
        return self.scales[name] * sigma.reshape(value.shape)

    def said(self) -> dict[str, object]:
        """What a calibration file keeps of the fit."""
        prior = self.smoothness and {"height_m": self.smoothness.height, "length_of_patch": self.smoothness.length}
        return {"outcome": self.outcome.value, "iterations": self.iterations, "sigma_px": self.sigma, "relief_prior": prior}


def fit_joint(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    *,
    free: Mapping[str, float | Tensor] | None = None,
    start: Start | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> JointFit:
    """Maximum a posteriori amplitudes, free numbers and poses; the strength of the prior and the noise by evidence.

    Args:
        path: with or without a relief.
        values: the start; free numbers have their prior's mean here.
        poses: (V, 6) to start from, or (V, 12) where boards move during the readout.
        free: standard deviation of each free number's prior, by name; `values` hold its mean.
        start: where to start instead, with the noise and the prior that are kept.
        progress: called with the number of linearisations so far and the RMS px.
    """
    free = free or {}
    # A corner whose ray does not get through the cover at the start says nothing, and must not forbid every step.
    begin = start.values if start else values
    observations = observations.kept(path.land(observations.pixels, observations.told(begin), poses[observations.view])[1] == 0)
    relief = path.cover[-1].relief if path.cover else None
    scales = {param.name: param.scale for param in path.params if param.name in free}
    model = Shared(values, relief, scales)
    fixed = np.concatenate([*((scale / _sigmas(free[name], values[name])) ** 2 for name, scale in scales.items()), np.zeros(0)])
    sigma, smoothness = (start.sigma, start.smoothness) if start else (FIRST_SIGMA, FIRST_PRIOR if relief else None)
    shared = model.of(begin)
    spent = 0
    for tolerance in AGAIN if start else ROUNDS:
        precision = _precision(relief, smoothness, fixed).to(shared)
        here = model.at(shared)
        weights = pixel_weights(path, here, observations, poses, sigma)
        views = landings(path, here, observations, weights, tuple(scales), relief is not None)
        solution = minimise(LandingProblem(model, tuple(views), precision, view_precision(poses)), shared, poses, tolerance=tolerance)
        shared, poses, spent = solution.shared, solution.blocks, spent + solution.iterations
        if progress:
            progress(spent, sigma * (solution.equations.sum_of_squares / len(observations.pixels)) ** 0.5)
        if solution.outcome is Outcome.NOT_FINITE:
            break
        if not start and tolerance != ROUNDS[-1]:
            freedom = 2 * len(observations.pixels) - poses.numel()
            sigma, smoothness = _by_evidence(solution, freedom, sigma, smoothness, relief, fixed)
    hessian, _ = solution.equations.schur_complement()
    covariance = torch.linalg.inv_ex(hessian + precision).inverse if model.count else hessian
    finite = solution.outcome is not Outcome.NOT_FINITE and bool(torch.isfinite(covariance).all())
    outcome = solution.outcome if finite else Outcome.NOT_FINITE
    covariance = covariance if finite else torch.full_like(covariance, torch.nan)
    return JointFit(model.at(shared), poses, covariance, sigma, smoothness, scales, outcome, spent)


def _by_evidence(
    solution: Solution, freedom: int, sigma: float, smoothness: Smoothness | None, relief: Relief | None, fixed: np.ndarray
) -> tuple[float, Smoothness | None]:
    """The noise (px) and the smoothness that are most probable, from where a fit with the noise `sigma` ended."""
    hessian, gradient = (part.cpu().numpy() * sigma**2 for part in solution.equations.schur_complement())
    square = solution.equations.sum_of_squares * sigma**2
    quadratic = Quadratic.around(hessian, gradient, square, freedom, solution.shared.cpu().numpy())
    return most_probable(Evidence(quadratic, relief, fixed), (square / freedom) ** 0.5, smoothness)


def _sigmas(prior: float | Tensor, value: Tensor) -> np.ndarray:
    """(n,) of a number's entries."""
    return np.broadcast_to(np.asarray(prior, dtype=np.float64), value.shape).ravel()


def shared_precision(path: Path, smoothness: Smoothness | None, free: Mapping[str, float | Tensor], means: Values) -> np.ndarray:
    """(S, S) of the prior on a path's shared numbers, free ones over their scales."""
    fixed = [(p.scale / _sigmas(free[p.name], means[p.name])) ** 2 for p in path.params if p.name in free]
    relief = path.cover[-1].relief if path.cover else None
    return _precision(relief, smoothness, np.concatenate([*fixed, np.zeros(0)])).numpy()


def _precision(relief: Relief | None, smoothness: Smoothness | None, fixed: np.ndarray) -> Tensor:
    """(S, S) of the prior: amplitudes, then free numbers."""
    amplitudes = smoothness.precision(relief) if relief and smoothness else np.zeros((0, 0))
    return torch.from_numpy(block_diag(amplitudes, np.diag(fixed)))
