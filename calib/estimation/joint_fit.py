"""The joint fit: maximum a posteriori amplitudes, free parameters and poses, with the noise and the
prior's scale by evidence.

It goes in rounds. In each, the solver finds the parameters with a given noise and prior; after it,
noise and prior are estimated from the residuals and the amplitudes. The covariance and the evidence
are those of the last round.

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

from calib.estimation.covariance import invert_precision
from calib.estimation.levenberg_marquardt import Outcome, Solution, minimise
from calib.estimation.normal_equations import NormalEquations, ReducedEquations
from calib.estimation.objective import LandingProblem, huber_limit, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE, Priors
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import reach_board
from calib.estimation.surface_prior import (
    MarginalLikelihood,
    Quadratic,
    Smoothness,
    maximise_evidence,
)
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.schema import Number

FIRST_SIGMA = 0.1
"""px: the noise with which a fit starts."""
GOOD_GLASS = Smoothness(height=1e-7, length=0.4)
"""The start of a fit that should explain as much as possible by its free parameters. With a loose
prior, the relief would imitate them and drift together with them.
"""
UNEVEN_GLASS = Smoothness(height=1e-5, length=0.4)
"""The start of a fit that should explain as much as possible by the glass."""
ROUNDS = (3e-3, 3e-4, 1e-5)
"""The tolerances of consecutive rounds of one fit. Between them, the prior, the noise and the pixel
weights are estimated again.
"""
WARM_ROUNDS = (1e-4,)
"""The rounds of a fit that starts at the result of a similar fit, and keeps its noise and prior."""
MAX_ITERATIONS = 100
"""The limit on linearisations in one round: two of a hundred sessions, with every number free,
needed 50.
"""
ROUGH_ROUNDS = (1e-3,)
"""The rounds of a fit that serves as the start of another fit."""


@dataclass(frozen=True, slots=True)
class Start:
    """The result of an earlier fit, as the start of another."""

    values: Values
    sigma: float
    """px"""
    smoothness: Smoothness | None


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimate of a model: its parameters, poses and covariance."""

    values: dict[str, Tensor]
    poses: Tensor
    """(V, 6)"""
    covariance: Tensor
    """(S, S) covariance of the shared parameters' vector; poses are marginalised. NaN if the fit
    is not finite.
    """
    sigma: float
    """px: the standard deviation of a corner in x and in y."""
    smoothness: Smoothness | None
    parameters: Parameters
    """The estimated shared parameters, and their places in the covariance."""

    @property
    def start(self) -> Start:
        """The start of a similar fit."""
        return Start(self.values, self.sigma, self.smoothness)

    @property
    def finite(self) -> bool:
        """True if the covariance is finite."""
        return bool(torch.isfinite(self.covariance).all())

    @property
    def saved_covariance(self) -> np.ndarray:
        """The covariance for a calibration file; (0, 0) if the fit is not finite."""
        return self.covariance.numpy() if self.finite else np.zeros((0, 0))

    def estimates(self) -> dict[str, Number]:
        """Return the free scalars with their standard deviations, in SI units; the latter are NaN
        if the fit is not finite.
        """
        scalars = (param.name for param in self.parameters.free if not self.values[param.name].ndim)
        return {
            name: Number(float(self.values[name]), float(self.sigma_of(name))) for name in scalars
        }

    def sigma_of(self, name: str) -> Tensor:
        """Return the standard deviation of a free parameter, in the parameter's shape."""
        return self.parameters.sigma(name, self.covariance)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit(Estimate):
    """The result of a joint fit."""

    cost: float
    """The minimum: the robust squares of the corners over sigma squared, plus those of the
    priors.
    """
    outcome: Outcome
    iterations: int
    """The number of linearisations in all rounds."""
    log_evidence: float
    """The logarithm of the corners' probability with the shared parameters integrated out. It lacks
    a constant that is the same for all models of the same corners and views.
    """
    log_marginal: float
    """The same with the views' parameters integrated out as well: it compares models whose views
    have different parameters.
    """

    @property
    def finite(self) -> bool:
        """True if the fit ended at finite values."""
        return self.outcome is not Outcome.NOT_FINITE


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
    """Fit the maximum a posteriori amplitudes, free parameters and poses; estimate the prior's
    scale and the noise by evidence.

    Args:
        path: a path with or without a relief.
        values: the start, and the means of the priors of the free parameters.
        poses: (V, 6) poses to start from, or (V, 12) if boards move during the readout.
        priors: the priors of the free parameters.
        start: another start, in place of `values`.
        rounds: the tolerances of consecutive rounds. Noise and prior are estimated between rounds,
            so a single round keeps those of the start.
        progress: called with the number of linearisations so far and the RMS px.
    """
    # A corner whose ray does not get through the cover at the start carries no information. It must
    # not make every step impossible.
    initial = start.values if start else values
    observations = observations.select_rows(reach_board(path, initial, observations, poses))
    parameters = Parameters.of(path, values, priors)
    sigma = start.sigma if start else FIRST_SIGMA
    smoothness = ((start and start.smoothness) or UNEVEN_GLASS) if path.relief else None
    shared = parameters.vector(initial)
    freedom = max(1, observations.residual_count - poses.numel())
    iterations = 0
    for tolerance in rounds:
        problem = _problem(path, parameters, observations, poses, shared, sigma, smoothness)
        solution = minimise(problem, shared, poses, steps=MAX_ITERATIONS, tolerance=tolerance)
        shared, poses = solution.shared, solution.blocks
        iterations += solution.iterations
        if progress:
            mean_square = solution.equations.sum_of_squares / len(observations.pixels)
            progress(iterations, sigma * mean_square**0.5)
        if solution.outcome is Outcome.NOT_FINITE:
            break
        if tolerance != rounds[-1]:
            evidence, apparent = marginal_likelihood(
                solution.equations, shared, freedom, sigma, parameters, observations.merged_squares
            )
            sigma, smoothness = maximise_evidence(evidence, apparent, smoothness)
    reduced = solution.equations.eliminate_blocks()
    covariance, finite = _covariance(solution, reduced, problem)
    log_evidence = -math.inf
    if finite:
        evidence, _ = marginal_likelihood(
            solution.equations, shared, freedom, sigma, parameters, observations.merged_squares
        )
        gradient = reduced.gradient + problem.precision @ shared
        excess = float(gradient @ covariance @ gradient)
        # The evidence assumes the cost at the minimum of its quadratic. A fit that is stuck has a
        # larger cost, by this excess.
        log_evidence = evidence.log(sigma, smoothness) - excess / 2
    return JointFit(
        values=parameters.values(shared),
        poses=poses,
        covariance=covariance,
        cost=solution.cost,
        sigma=sigma,
        smoothness=smoothness,
        parameters=parameters,
        outcome=solution.outcome if finite else Outcome.NOT_FINITE,
        iterations=iterations,
        log_evidence=log_evidence,
        log_marginal=log_evidence + _log_block_evidence(path, solution, sigma),
    )


def _problem(
    path: Path,
    parameters: Parameters,
    observations: Observations,
    poses: Tensor,
    shared: Tensor,
    sigma: float,
    smoothness: Smoothness | None,
) -> LandingProblem:
    """Return the solver's problem of one round: with this noise and prior, and with the weights
    that pixels have at these (S,) shared parameters and poses.
    """
    precision = torch.from_numpy(parameters.prior_precision(smoothness)).to(shared)
    values = parameters.values(shared)
    weights = pixel_weights(path, values, observations, poses, sigma)
    blocks = tuple(make_residual_blocks(path, parameters, observations, weights, values))
    return LandingProblem(
        parameters, blocks, precision, view_precision(path, poses), huber_limit(observations)
    )


def _covariance(
    solution: Solution, reduced: ReducedEquations, problem: LandingProblem
) -> tuple[Tensor, bool]:
    """Return the (S, S) covariance of the shared parameters, and whether fit and covariance are
    finite. If not, it is NaN.
    """
    covariance = reduced.hessian
    if problem.parameters.count:
        covariance = invert_precision(reduced.hessian + problem.precision)
    finite = solution.outcome is not Outcome.NOT_FINITE and bool(torch.isfinite(covariance).all())
    return (covariance if finite else torch.full_like(covariance, torch.nan)), finite


def marginal_likelihood(
    equations: NormalEquations,
    shared: Tensor,
    freedom: int,
    sigma: float,
    parameters: Parameters,
    merged_squares: float = 0.0,
) -> tuple[MarginalLikelihood, float]:
    """Return the evidence as a function of noise and smoothness, and the RMS residual, px per axis.

    Args:
        equations: those at the (S,) shared parameters, with the noise `sigma`.
        freedom: the number of residuals minus that of the view parameters.
        merged_squares: px^2, the squares of merged corners about their averages
            (`Observations`).
    """
    reduced = equations.eliminate_blocks()
    hessian = reduced.hessian.cpu().numpy() * sigma**2
    gradient = reduced.gradient.cpu().numpy() * sigma**2
    square = equations.sum_of_squares * sigma**2 + merged_squares
    quadratic = Quadratic.around(hessian, gradient, square, freedom, shared.cpu().numpy())
    glass = parameters.glass_prior
    joint_root = partial(parameters.joint_root, glass=glass) if glass else None
    return (
        MarginalLikelihood(quadratic, parameters.relief, parameters.free_root(), joint_root),
        (square / freedom) ** 0.5,
    )


def _log_block_evidence(path: Path, solution: Solution, sigma: float) -> float:
    """Return the term that integrating out the views' parameters adds to the log evidence: the
    width of their posterior relative to that of their prior (Laplace). A pose has no prior; every
    model gets the same unit prior for it. It is -infinity if the corners of a view do not determine
    its parameters.
    """
    blocks, precision = solution.blocks, view_precision(path, solution.blocks)
    log_determinant = torch.linalg.slogdet(solution.equations.hessian_block).logabsdet.sum()
    if not torch.isfinite(log_determinant):
        return -math.inf
    informative = precision[precision > 0]
    prior_cost = float((blocks**2 @ precision).sum())
    return float(
        len(blocks) * informative.log().sum() - log_determinant - prior_cost
    ) / 2 - blocks.numel() * math.log(sigma)
