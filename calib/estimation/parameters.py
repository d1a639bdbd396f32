"""The shared parameters of a fit: their names, scales and priors, and where each stands in the
solver's vector.
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
from calib.estimation.surface_prior import Smoothness, basis, waves
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.glass import Glass

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameters:
    """What a fit estimates beside the parameters of each view.

    The vector holds the relief's amplitudes (m), row by row, then the entries of each free
    parameter over its scale, all as deviations from `origin`.
    """

    origin: Values
    """Every value of the path: where the vector is zero, and the means of the priors."""
    relief: Relief | None
    """Whose amplitudes are estimated."""
    free: tuple[Param, ...]
    """The others that are estimated, in the vector's order."""
    priors: Priors
    """Of the free parameters."""

    @staticmethod
    def of(path: Path, origin: Values, priors: Priors, last: Iterable[str] = ()) -> Parameters:
        """Of a path's relief and of those of its parameters that have a prior, in the path's order,
        but the `last` ones last.
        """
        free = [param for param in path.params if param.name in priors.sigmas]
        return Parameters(
            origin, path.relief, tuple(sorted(free, key=lambda param: param.name in last)), priors
        )

    @staticmethod
    def none(origin: Values) -> Parameters:
        """Nothing is shared: only the views' own parameters are estimated."""
        return Parameters(origin, None, (), NONE)

    @property
    def amplitudes(self) -> int:
        return self.relief.grid[0] * self.relief.grid[1] if self.relief else 0

    @property
    def count(self) -> int:
        return self.amplitudes + sum(self.origin[param.name].numel() for param in self.free)

    @property
    def scales(self) -> Tensor:
        """(F,) of each entry of the free parameters."""
        like = next(iter(self.origin.values()))
        return like.new_tensor(
            [param.scale for param in self.free for _ in range(self.origin[param.name].numel())]
        )

    def slices(self) -> dict[str, slice]:
        """Where each parameter stands."""
        begin, found = (
            self.amplitudes,
            ({AMPLITUDES: slice(0, self.amplitudes)} if self.relief else {}),
        )
        for param in self.free:
            found[param.name] = slice(begin, begin + self.origin[param.name].numel())
            begin = found[param.name].stop
        return found

    def entries(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Where the entries of these parameters stand."""
        slices = self.slices()
        return np.concatenate(
            [np.zeros(0, np.int64), *(np.r_[slices[name]] for name in names)]
        ).astype(np.int64)

    def values(self, vector: Tensor) -> dict[str, Tensor]:
        """Every value of the path at (S,)."""
        moved = dict(self.origin)
        if self.relief:
            moved[AMPLITUDES] = moved[AMPLITUDES] + vector[: self.amplitudes].reshape(
                self.relief.grid
            )
        slices = self.slices()
        for param in self.free:
            moved[param.name] = moved[param.name] + param.scale * vector[
                slices[param.name]
            ].reshape(moved[param.name].shape)
        return moved

    def vector(self, values: Values) -> Tensor:
        """The (S,) at which the path has these values."""
        scales = ({AMPLITUDES: 1.0} if self.relief else {}) | {
            param.name: param.scale for param in self.free
        }
        parts = [
            (values[name] - self.origin[name]).flatten() / scale for name, scale in scales.items()
        ]
        return torch.cat(parts) if parts else next(iter(self.origin.values())).new_zeros(0)

    def prior_precision(self, smoothness: Smoothness | None) -> Array:
        """(S, S) inverse covariance of the vector beforehand."""
        if (glass := self.known_glass) and smoothness:
            assert self.relief
            to_heights = block_diag(basis(self.relief), np.eye(self.count - self.amplitudes))
            half = solve_triangular(self.joint_root(smoothness, glass), to_heights, lower=True)
            return np.asarray(half.T @ half)
        amplitudes = (
            smoothness.precision(self.relief) if self.relief and smoothness else np.zeros((0, 0))
        )
        free = self.free_root()
        whitened = solve_triangular(free, np.eye(len(free)), lower=True)
        return np.asarray(block_diag(amplitudes, whitened.T @ whitened))

    def prior_root(self, smoothness: Smoothness) -> Array:
        """(S, S) R with R R^T the covariance of the vector beforehand."""
        if glass := self.known_glass:
            assert self.relief
            to_heights = block_diag(basis(self.relief), np.eye(self.count - self.amplitudes))
            return np.asarray(np.linalg.solve(to_heights, self.joint_root(smoothness, glass)))
        amplitudes = (
            np.linalg.solve(basis(self.relief), smoothness.root(self.relief))
            if self.relief
            else np.zeros((0, 0))
        )
        return np.asarray(block_diag(amplitudes, self.free_root()))

    @property
    def known_glass(self) -> Glass | None:
        """Whose figure the relief is expected to have, beside the free parameters; None: that of
        any glass, on its own.
        """
        return self.priors.glass if self.relief else None

    def joint_root(self, smoothness: Smoothness, glass: Glass) -> Array:
        """(S, S) the lower Cholesky factor of the covariance of the heights at the centres and the
        free parameters, over their scales.
        """
        assert self.relief
        free, slices = self.free_root(), self.slices()
        coefficients = np.zeros((len(glass.mean), len(free)))
        for name, column in zip(glass.numbers, glass.cross_covariance.T, strict=True):
            if name in slices:
                at = slices[name].start - self.amplitudes
                coefficients[:, at] = column / float(self.scales[at])
        beside = waves(self.relief, glass.low, glass.high, glass.degree) @ coefficients
        return np.asarray(
            cholesky(
                np.block(
                    [[smoothness.covariance(self.relief, glass), beside], [beside.T, free @ free.T]]
                ),
                lower=True,
            )
        )

    def free_root(self) -> Array:
        """(F, F) the lower Cholesky factor of the covariance of the free parameters' entries
        beforehand, over their scales.
        """
        sigmas = self.priors.sigmas
        each = (
            np.broadcast_to(np.asarray(sigmas[p.name]) / p.scale, self.origin[p.name].shape).ravel()
            for p in self.free
        )
        spread = np.concatenate([np.zeros(0), *each])
        blocks = {
            name: slice(place.start - self.amplitudes, place.stop - self.amplitudes)
            for name, place in self.slices().items()
        }
        places = {name: block.start for name, block in blocks.items()}
        correlation = np.eye(len(spread))
        for (one, other), value in self.priors.correlations.items():
            if one in places and other in places:
                correlation[places[one], places[other]] = correlation[
                    places[other], places[one]
                ] = value
        root = np.asarray(spread[:, None] * cholesky(correlation, lower=True))
        for param in self.free:
            if param.name in self.priors.roots:
                root[blocks[param.name], blocks[param.name]] = (
                    self.priors.roots[param.name] / param.scale
                )
        return root

    def sigma(self, name: str, covariance: Tensor) -> Tensor:
        """The standard deviation of a free parameter, shaped as it is and in its unit, from the
        vector's (S, S) covariance.
        """
        scale = next(param.scale for param in self.free if param.name == name)
        variance = covariance.diagonal()[self.slices()[name]].clamp_min(0.0)
        return scale * variance.sqrt().reshape(self.origin[name].shape)
