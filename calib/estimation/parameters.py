"""The shared parameters of a fit: their names, scales and priors, and their places in the solver's
vector.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky, solve_triangular
from torch import Tensor

from calib.estimation.priors import NONE, Priors
from calib.estimation.surface_prior import Smoothness, figure_heights, relief_basis
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.glass import Glass

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameters:
    """The shared parameters that a fit estimates.

    The vector holds the relief's amplitudes (m), row by row, then the entries of each free
    parameter over its scale, all as deviations from `origin`.
    """

    origin: Values
    """Every value of the path at the zero vector. These are the means of the priors."""
    relief: Relief | None
    """The relief whose amplitudes are estimated."""
    free: tuple[Param, ...]
    """The other estimated parameters, in the vector's order."""
    priors: Priors
    """The priors of the free parameters."""

    def __post_init__(self) -> None:
        names = [param.name for param in self.free]
        assert len(set(names)) == len(names), names  # each has one place in the vector

    @staticmethod
    def of(path: Path, origin: Values, priors: Priors, last: Iterable[str] = ()) -> Parameters:
        """Return the parameters of a path: its relief, and every parameter that has a prior, in the
        path's order except that those named in `last` come last.
        """
        free = [param for param in path.params if param.name in priors.sigmas]
        return Parameters(
            origin, path.relief, tuple(sorted(free, key=lambda param: param.name in last)), priors
        )

    @staticmethod
    def none(origin: Values) -> Parameters:
        """Return parameters for a fit that estimates the view parameters only."""
        return Parameters(origin, None, (), NONE)

    @property
    def amplitudes(self) -> int:
        return self.relief.grid[0] * self.relief.grid[1] if self.relief else 0

    @property
    def count(self) -> int:
        return self.amplitudes + sum(self.origin[param.name].numel() for param in self.free)

    @property
    def scales(self) -> Tensor:
        """The (F,) scales of the entries of the free parameters."""
        like = next(iter(self.origin.values()))
        return like.new_tensor(
            [param.scale for param in self.free for _ in range(self.origin[param.name].numel())]
        )

    def slices(self) -> dict[str, slice]:
        """Return the slice of each parameter in the vector."""
        slices = {AMPLITUDES: slice(0, self.amplitudes)} if self.relief else {}
        start = self.amplitudes
        for param in self.free:
            stop = start + self.origin[param.name].numel()
            slices[param.name] = slice(start, stop)
            start = stop
        return slices

    def entries(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Return the indices of the entries of these parameters in the vector."""
        slices = self.slices()
        return np.concatenate(
            [np.zeros(0, np.int64), *(np.r_[slices[name]] for name in names)]
        ).astype(np.int64)

    def values(self, vector: Tensor) -> dict[str, Tensor]:
        """Return every value of the path at the (S,) vector."""
        values = dict(self.origin)
        if self.relief:
            values[AMPLITUDES] = values[AMPLITUDES] + vector[: self.amplitudes].reshape(
                self.relief.grid
            )
        slices = self.slices()
        for param in self.free:
            entries = vector[slices[param.name]].reshape(values[param.name].shape)
            values[param.name] = values[param.name] + param.scale * entries
        return values

    def vector(self, values: Values) -> Tensor:
        """Return the (S,) vector at which the path has these values."""
        scales = ({AMPLITUDES: 1.0} if self.relief else {}) | {
            param.name: param.scale for param in self.free
        }
        entries = [
            (values[name] - self.origin[name]).flatten() / scale for name, scale in scales.items()
        ]
        return torch.cat(entries) if entries else next(iter(self.origin.values())).new_zeros(0)

    def prior_precision(self, smoothness: Smoothness | None) -> Array:
        """Return the (S, S) inverse of the vector's prior covariance."""
        if (glass := self.glass_prior) and smoothness:
            assert self.relief
            to_heights = block_diag(relief_basis(self.relief), np.eye(self.count - self.amplitudes))
            half = solve_triangular(self.joint_root(smoothness, glass), to_heights, lower=True)
            return np.asarray(half.T @ half)
        amplitudes = (
            smoothness.precision(self.relief) if self.relief and smoothness else np.zeros((0, 0))
        )
        free = self.free_root()
        whitened = solve_triangular(free, np.eye(len(free)), lower=True)
        return np.asarray(block_diag(amplitudes, whitened.T @ whitened))

    def prior_root(self, smoothness: Smoothness) -> Array:
        """Return the (S, S) matrix R such that R R^T is the vector's prior covariance."""
        if glass := self.glass_prior:
            assert self.relief
            to_heights = block_diag(relief_basis(self.relief), np.eye(self.count - self.amplitudes))
            return np.asarray(np.linalg.solve(to_heights, self.joint_root(smoothness, glass)))
        amplitudes = (
            np.linalg.solve(relief_basis(self.relief), smoothness.root(self.relief))
            if self.relief
            else np.zeros((0, 0))
        )
        return np.asarray(block_diag(amplitudes, self.free_root()))

    @property
    def glass_prior(self) -> Glass | None:
        """The prior of the relief's figure, correlated with the free parameters; None if the relief
        has the prior of any glass, independent of them.
        """
        return self.priors.glass if self.relief else None

    def joint_root(self, smoothness: Smoothness, glass: Glass) -> Array:
        """Return the (S, S) lower Cholesky factor of the prior covariance of the heights at the
        prior's points and the free parameters, over their scales.
        """
        assert self.relief
        free, slices = self.free_root(), self.slices()
        coefficients = np.zeros((len(glass.mean), len(free)))
        for name, column in zip(glass.numbers, glass.cross_covariance.T, strict=True):
            if name in slices:
                entry = slices[name].start - self.amplitudes
                coefficients[:, entry] = column / float(self.scales[entry])
        cross = figure_heights(self.relief, glass.low, glass.high, glass.degree) @ coefficients
        heights = smoothness.covariance(self.relief, glass)
        covariance = np.block([[heights, cross], [cross.T, free @ free.T]])
        return np.asarray(cholesky(covariance, lower=True))

    def free_root(self) -> Array:
        """Return the (F, F) lower Cholesky factor of the prior covariance of the free parameters'
        entries, over their scales.
        """
        sigmas = self.priors.sigmas
        spreads = (
            np.broadcast_to(np.asarray(sigmas[p.name]) / p.scale, self.origin[p.name].shape).ravel()
            for p in self.free
        )
        spread = np.concatenate([np.zeros(0), *spreads])
        blocks = {
            name: slice(place.start - self.amplitudes, place.stop - self.amplitudes)
            for name, place in self.slices().items()
        }
        correlation = np.eye(len(spread))
        for (first, second), value in self.priors.correlations.items():
            if first in blocks and second in blocks:
                row, column = blocks[first].start, blocks[second].start
                correlation[row, column] = value
                correlation[column, row] = value
        root = np.asarray(spread[:, None] * cholesky(correlation, lower=True))
        for param in self.free:
            if param.name in self.priors.roots:
                root[blocks[param.name], blocks[param.name]] = (
                    self.priors.roots[param.name] / param.scale
                )
        return root

    def sigma(self, name: str, covariance: Tensor) -> Tensor:
        """Return the standard deviation of a free parameter, in its shape and unit, from the
        vector's (S, S) covariance.
        """
        scale = next(param.scale for param in self.free if param.name == name)
        variance = covariance.diagonal()[self.slices()[name]].clamp_min(0.0)
        return scale * variance.sqrt().reshape(self.origin[name].shape)
