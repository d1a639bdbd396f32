"""The joint fit: maximum a posteriori amplitudes, free parameters and poses, with the noise and the
prior's scale by evidence.

Source: D. J. C. MacKay, Bayesian interpolation (1992), for the evidence (the marginal likelihood of
    the residuals).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from calib.estimation.levenberg_marquardt import Outcome, Solution, minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE, Priors
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.estimation.surface_prior import MarginalLikelihood, Quadratic, Smoothness, most_probable
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.schema import Number

FIRST_SIGMA = 0.1
"""px"""
GOOD_GLASS = Smoothness(height=1e-7, length=0.4)
"""Where a fit begins whose numbers are to explain what they can: a relief that starts loose wanders
off along what they can do as well.
"""
UNEVEN_GLASS = Smoothness(height=1e-5, length=0.4)
"""Where one begins whose glass is to."""
ROUNDS = (3e-3, 3e-4, 1e-5)
"""Tolerances of one fit after another; between them the prior, the noise and the pixel weighting
are estimated anew.
"""
AGAIN = (1e-4,)
"""The same of a fit that starts where one like it ended, and keeps its noise and prior."""
STEPS = 100
"""Linearisations of one of them at most: two of a hundred sessions, with every number free, used up
50.
"""
ROUGH = (1e-3,)
"""The same of a fit that is the start of another."""


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
    """(S, S) of the shared parameters' vector; poses are marginalised.

    NaN where the outcome is NOT_FINITE.
    """
    cost: float
    """What was minimised: the corners' robust squares over those of sigma, and the priors'."""
    sigma: float
    """px: standard deviation of a corner in x and in y, estimated."""
    smoothness: Smoothness | None
    parameters: Parameters
    """What was estimated beside the poses, and where each stands in the covariance."""
    outcome: Outcome
    iterations: int
    """Linearisations, of all rounds together."""
    log_evidence: float
    """The logarithm of the corners' probability, the shared parameters integrated out, up to a
    constant of the corners and views.
    """
    log_marginal: float
    """The same with the views' own parameters integrated out as well: it compares models in which
    these differ.
    """

    @property
    def start(self) -> Start:
        """For a fit like this one."""
        return Start(self.values, self.sigma, self.smoothness)

    @property
    def finite(self) -> bool:
        return self.outcome is not Outcome.NOT_FINITE

    @property
    def known_covariance(self) -> np.ndarray:
        """As a calibration keeps it: (0, 0) where it is not known."""
        return self.covariance.numpy() if self.finite else np.zeros((0, 0))

    def estimates(self) -> dict[str, Number]:
        """The free scalars with their standard deviations, in SI units; these are NaN where the fit
        is not finite.
        """
        scalars = (param.name for param in self.parameters.free if not self.values[param.name].ndim)
        return {
            name: Number(float(self.values[name]), float(self.sigma_of(name))) for name in scalars
        }

    def sigma_of(self, name: str) -> Tensor:
        """The standard deviation of a free parameter, shaped as it is."""
        return self.parameters.sigma(name, self.covariance)

    def said(self) -> dict[str, object]:
        """What a calibration file keeps of the fit."""
        prior = self.smoothness and {
            "height_m": self.smoothness.height,
            "length_of_patch": self.smoothness.length,
        }
        return {
            "outcome": self.outcome.value,
            "iterations": self.iterations,
            "sigma_px": self.sigma,
            "log_evidence": self.log_evidence,
            "relief_prior": prior,
        }


def fit_joint(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    *,
    priors: Priors = NONE,
    start: Start | None = None,
    rounds: Sequence[float] = ROUNDS,
    progress: Callable[[int, float], None] | None = None,
) -> JointFit:
    """Maximum a posteriori amplitudes, free parameters and poses; the prior's scale and the noise
    by evidence.

    Args:
        path: with or without a relief.
        values: the start; free parameters have their prior's mean here.
        poses: (V, 6) to start from, or (V, 12) where boards move during the readout.
        priors: of the free parameters; `values` hold their means.
        start: where to start instead.
        rounds: tolerances of one fit after another; noise and prior are estimated between them, so
            that one round keeps the start's.
        progress: called with the number of linearisations so far and the RMS px.
    """
    # A corner whose ray does not get through the cover at the start says nothing, and must not
    # forbid every step.
    begin = start.values if start else values
    observations = observations.kept(
        path.land(observations.pixels, observations.with_times(begin), poses[observations.view])[1]
        == 0
    )
    parameters = Parameters.of(path, values, priors)
    sigma = start.sigma if start else FIRST_SIGMA
    smoothness = ((start and start.smoothness) or UNEVEN_GLASS) if path.relief else None
    shared = parameters.vector(begin)
    spent = 0
    for tolerance in rounds:
        precision = torch.from_numpy(parameters.prior_precision(smoothness)).to(shared)
        here = parameters.values(shared)
        weights = pixel_weights(path, here, observations, poses, sigma)
        views = tuple(landings(path, parameters, observations, weights, here))
        problem = LandingProblem(parameters, views, precision, view_precision(path, poses))
        solution = minimise(problem, shared, poses, steps=STEPS, tolerance=tolerance)
        shared, poses, spent = solution.shared, solution.blocks, spent + solution.iterations
        if progress:
            progress(
                spent, sigma * (solution.equations.sum_of_squares / len(observations.pixels)) ** 0.5
            )
        if solution.outcome is Outcome.NOT_FINITE:
            break
        if tolerance != rounds[-1]:
            evidence, apparent = _evidence(solution, observations, sigma, parameters)
            sigma, smoothness = most_probable(evidence, apparent, smoothness)
    hessian, _ = solution.equations.schur_complement()
    covariance = inverse(hessian + precision) if parameters.count else hessian
    finite = solution.outcome is not Outcome.NOT_FINITE and bool(torch.isfinite(covariance).all())
    outcome = solution.outcome if finite else Outcome.NOT_FINITE
    covariance = covariance if finite else torch.full_like(covariance, torch.nan)
    log_evidence = (
        _evidence(solution, observations, sigma, parameters)[0].log(sigma, smoothness)
        if finite
        else -math.inf
    )
    log_marginal = log_evidence + _own_evidence(path, solution, sigma)
    return JointFit(
        values=parameters.values(shared),
        poses=poses,
        covariance=covariance,
        cost=solution.cost,
        sigma=sigma,
        smoothness=smoothness,
        parameters=parameters,
        outcome=outcome,
        iterations=spent,
        log_evidence=log_evidence,
        log_marginal=log_marginal,
    )


def inverse(precision: Tensor) -> Tensor:
    """(n, n) the covariance, symmetric to the last bit, of parameters whose units may differ by any
    power of ten. A direction that rounding alone tells has a variance as large as rounding leaves
    it.
    """
    scale = precision.diagonal().clamp_min(torch.finfo(precision.dtype).tiny).rsqrt()
    scales = scale[:, None] * scale
    scaled = precision * scales
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if failed and torch.isfinite(scaled).all():
        size, vectors = torch.linalg.eigh(scaled)
        size = size.clamp_min(len(size) * torch.finfo(size.dtype).eps)
        found = (vectors / size) @ vectors.mT
    else:
        found = torch.cholesky_inverse(factor)
    symmetric: Tensor = (found + found.mT) / 2
    return symmetric * scales


def _evidence(
    solution: Solution, observations: Observations, sigma: float, parameters: Parameters
) -> tuple[MarginalLikelihood, float]:
    """Of any noise and smoothness, from where a fit with the noise `sigma` ended; and what is left
    there, px per axis.
    """
    freedom = 2 * len(observations.pixels) - solution.blocks.numel()
    hessian, gradient = (
        part.cpu().numpy() * sigma**2 for part in solution.equations.schur_complement()
    )
    square = solution.equations.sum_of_squares * sigma**2
    quadratic = Quadratic.around(hessian, gradient, square, freedom, solution.shared.cpu().numpy())
    glass = parameters.known_glass
    joint_root = partial(parameters.joint_root, glass=glass) if glass else None
    return (
        MarginalLikelihood(quadratic, parameters.relief, parameters.free_root(), joint_root),
        (square / freedom) ** 0.5,
    )


def _own_evidence(path: Path, solution: Solution, sigma: float) -> float:
    """What integrating the views' own parameters out adds to the evidence: the width of their
    posterior in that of their prior (Laplace). A pose has no prior, and the same unit one in every
    model.
    """
    blocks, precision = solution.blocks, view_precision(path, solution.blocks)
    narrowed = torch.linalg.slogdet(solution.equations.hessian_block).logabsdet.sum()
    known = precision[precision > 0]
    apart = float((blocks**2 @ precision).sum())
    return float(
        len(blocks) * known.log().sum() - narrowed - apart
    ) / 2 - blocks.numel() * math.log(sigma)
