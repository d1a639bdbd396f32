"""The joint maximum-likelihood fit: relief amplitudes and any freed numbers together with every view's pose.

A corner's residual is its reprojection error to first order, e_px = -(d x_cb / d p)^-1 (x_cb(p) - x_true), over its standard
deviation. It depends on the relief only through the height and two slopes at the ray's own outer hit, so these three are
differentiated for each ray, and the basis spreads them over all amplitudes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.relief import PROBES, Relief
from calib.prior import Rows, Smoothness, most_probable
from calib.schema import Number
from calib.solve import Linearised, Outcome, minimise, normal_equations

FIRST_SIGMA = 0.1
"""px"""
FIRST_HEIGHT = 1e-5
"""m"""
FIRST_LENGTH = 0.4
ROUNDS = (1e-3, 1e-4, 1e-5, 1e-9)
"""Tolerances of one fit after another; between them the prior and the noise are estimated anew."""
HUBER = 3.0
"""Standard deviations beyond which a corner counts by its distance, not by its square."""


@dataclass(frozen=True, slots=True)
class JointProblem:
    """The solver's view of a fit. Shared numbers: the relief's amplitudes, row by row, then the free numbers over their scales, as
    deviations from `values`; blocks: poses."""

    path: Path
    values: Values
    observations: Observations
    free: Sequence[str]
    """Names of the scalar numbers that are estimated."""
    sigma: float
    """px: standard deviation of a corner in x and in y."""
    precision: Tensor
    """(S, S) of the prior on the shared numbers."""
    relief_known: bool = False
    """Whether the amplitudes are held, as for held-out views."""

    @property
    def starts(self) -> Tensor:
        return self.observations.starts

    @property
    def relief(self) -> Relief | None:
        """The relief that is estimated."""
        return self.path.cover[-1].relief if self.path.cover and not self.relief_known else None

    @property
    def scales(self) -> dict[str, float]:
        """The size of a typical change of each free number."""
        known = {param.name: param.scale for param in self.path.params}
        return {name: known[name] for name in self.free}

    def at(self, shared: Tensor) -> dict[str, Tensor]:
        """The path's numbers for (S,) shared ones."""
        count = len(shared) - len(self.free)
        moved = dict(self.values)
        if self.relief:
            moved["relief.amplitudes"] = self.values["relief.amplitudes"] + shared[:count].reshape(self.relief.grid)
        for (name, scale), change in zip(self.scales.items(), shared[count:], strict=True):
            moved[name] = self.values[name] + scale * change
        return moved

    def cost(self, shared: Tensor, blocks: Tensor) -> float:
        pixels = self.observations.pixels.detach().requires_grad_()
        with torch.enable_grad():
            landed, failure = self.path.land(pixels, self.at(shared), blocks[self.observations.view])
            (slopes,) = by_row(landed, [pixels])
        squared = (self._whitened(landed.detach(), slopes) ** 2).sum(-1)
        robust = torch.where(squared <= HUBER**2, squared, 2 * HUBER * squared.sqrt() - HUBER**2)
        return float(torch.where(failure == 0, robust, torch.inf).sum())

    def linearise(self, shared: Tensor, blocks: Tensor) -> Linearised:
        rows = len(self.observations.pixels)
        moved = self.at(shared)
        pixels = self.observations.pixels.detach().requires_grad_()
        poses = blocks[self.observations.view].detach().requires_grad_()
        numbers = [moved[name].expand(rows).clone().requires_grad_() for name in self.free]
        probes = [torch.zeros(rows, dtype=pixels.dtype, device=pixels.device, requires_grad=True) for _ in PROBES] if self.relief else []
        with torch.enable_grad():
            probed = moved | dict(zip(self.free, numbers, strict=True)) | dict(zip(PROBES, probes, strict=False))
            landed, _ = self.path.land(pixels, probed, poses)
            slopes, by_pose, *rest = by_row(landed, [pixels, poses, *probes, *numbers])
        by_probe, by_number = rest[: len(probes)], rest[len(probes) :]
        columns = []
        if self.relief:
            height, first, second = self.relief.columns(self._chart(pixels.detach(), moved))  # (M, n) each
            columns.append(sum(d.unsqueeze(-1) * b.unsqueeze(1) for d, b in zip(by_probe, (height, first, second), strict=True)))
        columns += [(d * scale).unsqueeze(-1) for d, scale in zip(by_number, self.scales.values(), strict=True)]
        by_shared = torch.cat(columns, -1) if columns else torch.zeros(rows, 2, 0, dtype=pixels.dtype)  # type: ignore[arg-type]
        residual = self._whitened(landed.detach(), slopes)
        size = residual.norm(dim=-1)
        robust = (HUBER / size.clamp_min(HUBER)).sqrt()  # the square root of Huber's weight
        scale = -(robust * self.observations.weight / self.sigma)[:, None, None]
        turn = torch.linalg.inv(slopes)
        return Linearised(residual * robust.unsqueeze(-1), scale * (turn @ by_pose), scale * (turn @ by_shared))

    def _whitened(self, landed: Tensor, slopes: Tensor) -> Tensor:
        """(M, 2) reprojection errors in standard deviations."""
        off = torch.linalg.solve(slopes, (landed - self.observations.corners).unsqueeze(-1)).squeeze(-1)
        return torch.mul(off, -(self.observations.weight / self.sigma).unsqueeze(-1))

    def _chart(self, pixels: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """Where each ray leaves the cover, in the relief's coordinates."""
        outer = self.path.cover[-1]
        rays = self.path.trace(pixels, values)
        first, second = outer.surface.chart(outer.frame.enter(rays.origin, values))
        return first, second


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
    problem = JointProblem(path, values, observations, tuple(free), FIRST_SIGMA, torch.zeros(0, 0))
    relief = problem.relief
    fixed = torch.tensor([(problem.scales[name] / sigma) ** 2 for name, sigma in free.items()], dtype=torch.float64)
    smoothness = Smoothness(FIRST_HEIGHT, FIRST_LENGTH) if relief else None
    shared = torch.zeros((relief.grid[0] * relief.grid[1] if relief else 0) + len(free), dtype=torch.float64)
    spent = 0
    for tolerance in ROUNDS:
        amplitudes = smoothness.precision(relief) if relief and smoothness else torch.zeros(0, 0, dtype=torch.float64)
        problem = replace(problem, precision=_blocks(amplitudes, torch.diag(fixed)))
        solution = minimise(problem, shared, poses, tolerance=tolerance)
        shared, poses, spent = solution.shared, solution.blocks, spent + solution.iterations
        at = problem.linearise(shared, poses)
        curvature, slope = normal_equations(problem.starts, at).reduced()
        if progress:
            progress(spent, problem.sigma * float((at.residual**2).sum(-1).mean().sqrt()))
        if tolerance == ROUNDS[-1]:
            break
        rows = Rows(
            curvature * problem.sigma**2,
            slope * problem.sigma**2,
            float((at.residual**2).sum()) * problem.sigma**2,
            2 * len(observations.pixels) - poses.numel(),
        )
        sigma, smoothness = most_probable(rows, shared, relief, smoothness, fixed)
        problem = replace(problem, sigma=sigma)
    covariance = torch.linalg.inv(curvature + problem.precision) if len(shared) else curvature
    return JointFit(problem.at(shared), poses, covariance, problem.sigma, smoothness, problem.scales, solution.outcome, spent)


def _blocks(first: Tensor, second: Tensor) -> Tensor:
    """The block-diagonal matrix of two square ones."""
    joined = torch.zeros(len(first) + len(second), len(first) + len(second), dtype=first.dtype)
    joined[: len(first), : len(first)] = first
    joined[len(first) :, len(first) :] = second
    return joined
