"""The motion of the board in bursts: where it was a little later than a placement.

A burst is a series of placements whose pictures follow each other at short intervals, by their
`time_s`. The path of the board through a burst is a Gaussian process: white noise of the
acceleration in each of six coordinates, as of a hand that trembles, or of the jerk, as of one that
swings. The noise has one size for all rotations and one for all translations, of all bursts
together. The evidence of the placements chooses between the two, and the sizes. So a rough motion
gives uncertain speeds, not wrong ones.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian processes for machine learning (2006), sections
2.2 and 6.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
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
MARGIN = 0.5
"""s: a path begins so long before its first placement, more than any camera is late."""
SPEEDS = np.array([3.0] * 3 + [1.0] * 3)
"""rad/s and m/s: the prior standard deviations of the board's speed, those of a quick hand."""
PLACES = np.array([1.0] * 3 + [1.0] * 3)
"""rad and m: the same of its place in the frame of the first placement of its burst."""
ACCELERATIONS = np.array([6.0] * 3 + [2.0] * 3)
"""rad/s^2 and m/s^2: the same of its acceleration, where that has no white noise: those of a swing
at such speeds in 3 s.
"""
DECADES = 3.0
"""The search of this size ends so many factors of ten above and below."""

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
    """The white noise of a path's second or third derivative by time."""

    order: int
    """2 for the acceleration, 3 for the jerk."""
    sizes: Array
    """(6,) rad and m, over s^(order - 1/2)."""

    def scaled(self, factors: Array) -> Roughness:
        """Return the noise with other sizes of rotations and translations, by (2,) factors."""
        return Roughness(self.order, self.sizes * np.repeat(factors, 3))


ROUGHNESSES = (
    Roughness(2, np.array([1.0] * 3 + [0.1] * 3)),
    Roughness(3, np.array([10.0] * 3 + [1.0] * 3)),
)
"""The noises from which the search starts."""


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
    """(N,) s, from MARGIN on."""
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
            times=burst.times + MARGIN,
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
        early = np.minimum(first[:, None], second)
        late = np.maximum(first[:, None], second)
        gap = late - early
        product = (first - MARGIN)[:, None] * (second - MARGIN)
        if roughness.order == 2:
            bend = early**3 / 3 + gap * early**2 / 2
            accelerations = np.zeros(6)
        else:
            bend = early**5 / 20 + gap * early**4 / 8 + gap**2 * early**3 / 12
            accelerations = ACCELERATIONS
        total = np.zeros((len(first), 6, len(second), 6))
        for axis in range(6):
            total[:, axis, :, axis] = (
                PLACES[axis] ** 2
                + SPEEDS[axis] ** 2 * product
                + accelerations[axis] ** 2 * product**2 / 4
                + roughness.sizes[axis] ** 2 * bend
            )
        return total.reshape(6 * len(first), 6 * len(second))


def _most_probable(paths: Sequence[_Path], start: Roughness) -> tuple[Roughness, float]:
    """Return the noise with the most probable sizes, and the log evidence."""

    def cost(logs: Array) -> float:
        return -sum(path.log_evidence(start.scaled(np.exp(logs))) for path in paths)

    limit = DECADES * np.log(10.0)
    solution = minimize(
        cost,
        np.zeros(2),
        method="Nelder-Mead",
        bounds=[(-limit, limit)] * 2,
        options={
            "initial_simplex": [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]],
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
