"""The joint maximum-likelihood fit: relief amplitudes and any freed numbers together with every view's pose."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import block_diag
from torch import Tensor

from calib.landing import landings, pixel_weights
from calib.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.prior import Evidence, Quadratic, Smoothness, most_probable
from calib.problem import LandingProblem, Shared
from calib.schema import Number
from calib.solve import Outcome, Solution, minimise

FIRST_SIGMA = 0.1
"""px"""
FIRST_HEIGHT = 1e-5
"""m"""
FIRST_LENGTH = 0.4
ROUNDS = (1e-2, 1e-4, 1e-9)
"""Tolerances of one fit after another; between them the prior, the noise and the pixel weighting are estimated anew."""


@dataclass(frozen=True, slots=True)
class JointFit:
    """Where the joint fit ended."""

    values: dict[str, Tensor]
    poses: Tensor
    """(V, 6)"""
    covariance: Tensor
    """(S, S) of the shared numbers: amplitudes in m, free numbers over their scales. Poses are marginalised."""
    sigma: float
    """px: standard deviation of a corner in x and in y, estimated."""
    smoothness: Smoothness | None
    scales: Mapping[str, float]
    """Of the free numbers, in the order of the covariance's last rows."""
    outcome: Outcome
    iterations: int
    """Linearisations, of all rounds together."""

    def estimates(self) -> dict[str, Number]:
        """The free numbers with their standard deviations, in SI units."""
        sigmas = self.covariance.diagonal()[len(self.covariance) - len(self.scales) :].sqrt().tolist()
        return {
            name: Number(float(self.values[name]), scale * sigma) for (name, scale), sigma in zip(self.scales.items(), sigmas, strict=True)
        }

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
    free: Mapping[str, float] | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> JointFit:
    """Maximum a posteriori amplitudes, free numbers and poses; the strength of the prior and the noise by evidence.

    Args:
        path: with or without a relief.
        values: the start; free numbers have their prior's mean here.
        poses: (V, 6) to start from.
        free: standard deviation of each free scalar number's prior, by name.
        progress: called with the number of linearisations so far and the RMS px.
    """
    free = free or {}
    # A corner whose ray does not get through the cover at the start says nothing, and must not forbid every step.
    observations = observations.kept(path.land(observations.pixels, values, poses[observations.view])[1] == 0)
    relief = path.cover[-1].relief if path.cover else None
    scales = {param.name: param.scale for param in path.params if param.name in free}
    model = Shared(values, relief, scales)
    fixed = np.array([(scale / free[name]) ** 2 for name, scale in scales.items()])
    sigma, smoothness = FIRST_SIGMA, Smoothness(FIRST_HEIGHT, FIRST_LENGTH) if relief else None
    shared = observations.pixels.new_zeros(model.count)
    spent = 0
    for tolerance in ROUNDS:
        precision = _precision(relief, smoothness, fixed).to(shared)
        here = model.at(shared)
        weights = pixel_weights(path, here, observations, poses, sigma)
        views = landings(path, here, observations, weights, tuple(scales), relief is not None)
        solution = minimise(LandingProblem(model, tuple(views), precision), shared, poses, tolerance=tolerance)
        shared, poses, spent = solution.shared, solution.blocks, spent + solution.iterations
        if progress:
            progress(spent, sigma * (solution.normal.square / len(observations.pixels)) ** 0.5)
        if tolerance != ROUNDS[-1]:
            freedom = 2 * len(observations.pixels) - poses.numel()
            sigma, smoothness = _by_evidence(solution, freedom, sigma, smoothness, relief, fixed)
    curvature, _ = solution.normal.reduced()
    covariance = torch.linalg.inv(curvature + precision) if model.count else curvature
    return JointFit(model.at(shared), poses, covariance, sigma, smoothness, scales, solution.outcome, spent)


def _by_evidence(
    solution: Solution, freedom: int, sigma: float, smoothness: Smoothness | None, relief: Relief | None, fixed: np.ndarray
) -> tuple[float, Smoothness | None]:
    """The noise (px) and the smoothness that are most probable, from where a fit with the noise `sigma` ended."""
    curvature, slope = (part.cpu().numpy() * sigma**2 for part in solution.normal.reduced())
    square = solution.normal.square * sigma**2
    quadratic = Quadratic.around(curvature, slope, square, freedom, solution.shared.cpu().numpy())
    return most_probable(Evidence(quadratic, relief, fixed), (square / freedom) ** 0.5, smoothness)


def _precision(relief: Relief | None, smoothness: Smoothness | None, fixed: np.ndarray) -> Tensor:
    """(S, S) of the prior: amplitudes, then free numbers."""
    amplitudes = smoothness.precision(relief) if relief and smoothness else np.zeros((0, 0))
    return torch.from_numpy(block_diag(amplitudes, np.diag(fixed)))
