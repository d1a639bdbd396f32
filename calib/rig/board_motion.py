"""The motion of the board in bursts: where it was a little later than a placement.

A burst is a series of placements whose pictures follow each other at short intervals, by their
`time_s`. The path of the board through a burst is a Gaussian process in each of six coordinates,
with a Matérn covariance: white noise of the acceleration, as of a hand that trembles, or of the
third or fourth derivative, as of one that swings, and a pull back to the middle. The process has
one size for all rotations, one for all translations and one time scale, of all bursts together. The
evidence of the placements chooses between the three, and the sizes and the scale. So a rough motion
gives uncertain speeds, not wrong ones.

A board that turns back is slowed down in proportion to its distance. Without the pull back, the
path runs on too far after the last placement of a burst, and a lateness comes out too small.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections
2.2 and 4.2.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray
from scipy.optimize import minimize

from calib.optics import rotation
from calib.rig.poses import rotation_vector

MAX_INTERVAL = 0.25
"""s: the longest interval within a burst. A hand changes its direction within half a second."""
MIN_BURST = 3
"""The fewest placements of a burst: two have no smoothness."""
MAX_BURST = 40
"""The most placements of which the path is computed together; longer bursts are divided."""
PLACES = np.array([1.0] * 3 + [1.0] * 3)
"""rad and m: the prior standard deviation of the middle of a path in the frame of its first
placement.
"""
LIMITS = np.log([(1e-4, 10.0), (1e-4, 10.0), (0.1, 10.0)])
"""(3, 2) the search ends at these factors of the sizes of rotations and translations, and of the
time scale.
"""
MATERN = {2: (1.0, 1.0), 3: (1.0, 1.0, 1 / 3), 4: (1.0, 1.0, 2 / 5, 1 / 15)}
"""The polynomials of the Matérn correlations, by the derivative that has white noise."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Burst:
    """A series of placements at short intervals."""

    places: NDArray[np.int64]
    """(N,) the placements, in the order of time."""
    times: Array
    """(N,) s, 0 for the first one."""


@dataclass(frozen=True, slots=True, eq=False)
class Roughness:
    """The Matérn process of a path about its middle."""

    order: int
    """The derivative by time that has white noise: 2, 3 or 4."""
    sizes: Array
    """(6,) rad and m, the standard deviations."""
    scale_s: float
    """The time within which the path turns back, s."""

    def scaled(self, factors: Array) -> Roughness:
        """Return the process with other sizes of rotations and translations and another time
        scale, by (3,) factors.
        """
        sizes = self.sizes * np.repeat(factors[:2], 3)
        return Roughness(self.order, sizes, self.scale_s * float(factors[2]))

    def correlation(self, gaps: Array) -> Array:
        """Return the correlations of a coordinate at two times, by the gaps between them, s."""
        lags = np.sqrt(2 * self.order - 1) * np.abs(gaps) / self.scale_s
        return np.asarray(polyval(lags, MATERN[self.order]) * np.exp(-lags))


ROUGHNESSES = tuple(Roughness(order, np.array([0.3] * 3 + [0.1] * 3), 0.5) for order in MATERN)
"""The processes from which the search starts: motions of a hand."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardDisplacement:
    """The motion of the board from each placement to a moment later."""

    mean: Array
    """(P, 6) a rotation (rad) and a translation (m) of the board's origin, in the reference's
    frame; 0 outside of bursts.
    """
    covariance: Array
    """(P, 6, 6); 0 outside of bursts."""
    is_known: NDArray[np.bool_]
    """(P,) true for a placement of a burst."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardMotion:
    """The paths of the board through all bursts."""

    bursts: tuple[Burst, ...]
    count: int
    """P, the number of placements."""
    paths: tuple[_Path, ...]
    roughness: Roughness

    @staticmethod
    def of(placements: Array, covariances: Array, times: Array) -> BoardMotion:
        """Estimate the paths.

        Args:
            placements: (P, 6) T_reference_board.
            covariances: (P, 6, 6) of a small rotation (rad) and translation (m) of each.
            times: (P,) s; NaN where the time is not known.
        """
        bursts = find_bursts(times)
        paths = tuple(_Path.of(burst, placements, covariances) for burst in bursts)
        if not paths:
            return BoardMotion(bursts, len(placements), (), ROUGHNESSES[0])
        fitted = [_most_probable(paths, start) for start in ROUGHNESSES]
        roughness, _ = max(fitted, key=lambda fit: fit[1])
        return BoardMotion(bursts, len(placements), paths, roughness)

    def after(self, seconds: float) -> BoardDisplacement:
        """Return the motion of the board in some time after each placement; a negative time is one
        before.
        """
        mean = np.zeros((self.count, 6))
        covariance = np.zeros((self.count, 6, 6))
        is_known = np.zeros(self.count, np.bool_)
        for burst, path in zip(self.bursts, self.paths, strict=True):
            mean[burst.places], covariance[burst.places] = path.after(seconds, self.roughness)
            is_known[burst.places] = True
        return BoardDisplacement(mean, covariance, is_known)

    @property
    def interval_s(self) -> float:
        """The median interval between the placements of a burst, s; NaN without a burst."""
        if not self.bursts:
            return float("nan")
        return float(np.median(np.concatenate([np.diff(burst.times) for burst in self.bursts])))

    @property
    def speeds(self) -> tuple[float, float]:
        """The root mean square speeds in bursts, rad/s and m/s; NaN without a burst."""
        moment = self.after(1e-3)
        if not moment.is_known.any():
            return float("nan"), float("nan")
        squares = (moment.mean[moment.is_known] / 1e-3) ** 2
        turn, shift = squares[:, :3].sum(1).mean(), squares[:, 3:].sum(1).mean()
        return float(turn**0.5), float(shift**0.5)


def find_bursts(times: Array) -> tuple[Burst, ...]:
    """Return the bursts among placements at (P,) times, s; NaN where the time is not known."""
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order])]
    steps = np.diff(times[order])
    is_new = np.r_[True, (steps > MAX_INTERVAL) | (steps <= 0)]
    bursts = []
    for series in np.split(order, np.flatnonzero(is_new)[1:]):
        pieces = np.array_split(series, -(-len(series) // MAX_BURST)) if len(series) else []
        bursts += [
            Burst(piece.astype(np.int64), times[piece] - times[piece[0]])
            for piece in pieces
            if len(piece) >= MIN_BURST
        ]
    return tuple(bursts)


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """The path of the board through one burst, in the frame of its first placement."""

    times: Array
    """(N,) s"""
    coordinates: Array
    """(N, 6) the rotation vector from the first placement (rad) and the translation (m)."""
    noise: Array
    """(6 N, 6 N) the covariance of the placements."""
    turns: Array
    """(N, 3, 3) from a change of the rotation vector to a rotation about the reference's axes."""

    @staticmethod
    def of(burst: Burst, placements: Array, covariances: Array) -> _Path:
        poses = torch.from_numpy(placements[burst.places])
        turns = rotation.matrix(poses[:, :3])
        vectors = rotation_vector(turns @ turns[0].mT)
        to_axes = rotation.left_jacobian(vectors).numpy()
        shifts = (poses[:, 3:] - poses[0, 3:]).numpy()
        count = len(poses)
        noise = np.zeros((count, 6, count, 6))
        for index, covariance in enumerate(covariances[burst.places]):
            to_coordinates = np.eye(6)
            to_coordinates[:3, :3] = np.linalg.inv(to_axes[index])
            noise[index, :, index] = to_coordinates @ covariance @ to_coordinates.T
        return _Path(
            times=burst.times,
            coordinates=np.concatenate([vectors.numpy(), shifts], 1),
            noise=noise.reshape(6 * count, 6 * count),
            turns=to_axes,
        )

    def log_evidence(self, roughness: Roughness) -> float:
        factor = np.linalg.cholesky(
            self._covariance(self.times, self.times, roughness) + self.noise
        )
        whitened = np.linalg.solve(factor, self.coordinates.reshape(-1))
        return float(-np.log(factor.diagonal()).sum() - whitened @ whitened / 2)

    def after(self, seconds: float, roughness: Roughness) -> tuple[Array, Array]:
        """Return the (N, 6) motion within a time, and its (N, 6, 6) covariance."""
        count = len(self.times)
        later = self.times + seconds
        covariance_here = self._covariance(self.times, self.times, roughness)
        cross = self._covariance(later, self.times, roughness) - covariance_here
        prior = (
            self._covariance(later, later, roughness)
            - self._covariance(later, self.times, roughness)
            - self._covariance(self.times, later, roughness)
            + covariance_here
        )
        gain = np.linalg.solve(covariance_here + self.noise, cross.T).T
        mean = (gain @ self.coordinates.reshape(-1)).reshape(count, 6)
        covariance = (prior - gain @ cross.T).reshape(count, 6, count, 6)
        to_axes = np.zeros((count, 6, 6))
        to_axes[:, :3, :3] = self.turns
        to_axes[:, 3:, 3:] = np.eye(3)
        of_place = covariance[np.arange(count), :, np.arange(count)]
        motion = np.einsum("nij,nj->ni", to_axes, mean)
        return motion, to_axes @ of_place @ to_axes.swapaxes(1, 2)

    def _covariance(self, first: Array, second: Array, roughness: Roughness) -> Array:
        """Return the (6 A, 6 B) prior covariance of the coordinates at (A,) and (B,) times."""
        correlation = roughness.correlation(first[:, None] - second)
        total = np.zeros((len(first), 6, len(second), 6))
        for axis in range(6):
            total[:, axis, :, axis] = PLACES[axis] ** 2 + roughness.sizes[axis] ** 2 * correlation
        return total.reshape(6 * len(first), 6 * len(second))


def _most_probable(paths: Sequence[_Path], start: Roughness) -> tuple[Roughness, float]:
    """Return the process with the most probable sizes and scale, and the log evidence."""

    def cost(logs: Array) -> float:
        return -sum(path.log_evidence(start.scaled(np.exp(logs))) for path in paths)

    solution = minimize(
        cost,
        np.zeros(3),
        method="Nelder-Mead",
        bounds=[(low, high) for low, high in LIMITS.tolist()],
        options={
            "initial_simplex": np.vstack([np.zeros(3), np.diag([-1.0, -1.0, 0.5])]).tolist(),
            "xatol": 0.05,
            "fatol": 0.05,
        },
    )
    return start.scaled(np.exp(solution.x)), -float(solution.fun)


def motion_in_placement(placements: Array) -> Array:
    """Return the (P, 6, 6) changes of (P, 6) placements T_reference_board by a small rotation (rad)
    and translation (m) of the board about its origin, along the reference's axes.
    """
    turns = rotation.left_jacobian(torch.from_numpy(placements[:, :3]))
    changes = np.zeros((len(placements), 6, 6))
    changes[:, :3, :3] = np.linalg.inv(turns.numpy())
    changes[:, 3:, 3:] = np.eye(3)
    return changes


def placement_times(
    of_views: Sequence[NDArray[np.int64]], times: Sequence[Array], count: int
) -> Array:
    """Return the (P,) s times of placements by one camera, the one that has a time for most of
    them; NaN where it has none. The clocks of cameras may differ.

    Args:
        of_views: for each camera, the (V,) placement of each view.
        times: for each camera, the (V,) s times of its views; NaN where not recorded.
        count: P.
    """
    tables = np.full((len(times), count), np.nan)
    for table, places, seconds in zip(tables, of_views, times, strict=True):
        # Of several pictures of one placement, the first.
        table[places[::-1]] = seconds[::-1]
    return np.asarray(tables[np.isfinite(tables).sum(1).argmax()])
