"""The optimal design of further views: the information that each pose of a bank would add, and the
predicted uncertainty of the maps. No torch.

The shared parameters of the fit (relief, freed parameters) are represented by modes: independent
and standard normal before the first view, and restricted to those that move the maps. In these, a
view's information is a matrix that adds up over views, and the predicted variance of an undistorted
position is a row of `spread` through the inverse of that sum.

Source: A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum experimental designs, with SAS (2007),
chapter 10, for the mean predicted variance as the criterion (I-optimality) and for the sequential
choice of views.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_PLANNED_VIEWS = 40
"""The largest number of views in a plan."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """The information of a bank of P poses about R modes, and the effect of the modes on the
    maps.
    """

    poses: Array
    """(P, 6) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(P, count, 2) px of the board's corners as the camera sees them through the cover; NaN for a
    corner that it does not see.
    """
    information: Array
    """(P, R, R) information of each pose, with the board's pose itself eliminated."""
    initial_information: Array
    """(R, R) information of the existing views."""
    views: int
    """The number of existing views."""
    spread: Array
    """(h, w, 2, 2, R) px, px m: derivatives of A and B, x and y each, by the modes, at pixels over
    the picture; the undistorted position at depth Z is A + B / Z. Rigid motion of all rays is
    projected out. NaN where no ray leaves the cover.
    """
    depths: Array
    """(D,) m: the depths of the maps."""
    glass: Array
    """(h, w, 2) the points where the rays of those pixels leave the glass: down and to the right in
    its patch, each from 0 to 1.
    """

    def precision(self, extra: Array | None = None) -> Array:
        """Return the (R, R) precision of the modes: the prior, the existing views, and the extra
        information.
        """
        total = np.eye(len(self.initial_information)) + self.initial_information
        return total + (0 if extra is None else extra)

    def variance(self, precision: Array) -> Array:
        """Return the (h, w, D) px^2 predicted variance of the undistorted position, x and y
        together.
        """
        root = np.linalg.inv(np.linalg.cholesky(precision))
        return np.asarray(((self._position_derivatives() @ root.T) ** 2).sum((-2, -1)))

    def sigma(self, precision: Array) -> float:
        """Return the root of the mean variance over the picture and the depths, px."""
        return float(np.sqrt(np.nanmean(self.variance(precision))))

    def plan(
        self,
        precision: Array,
        used: NDArray[np.bool_],
        target: float,
        limit: int = MAX_PLANNED_VIEWS,
    ) -> list[int]:
        """Return the poses to take, in order: each lowers the mean variance most, until sigma is
        below a target in px.

        Args:
            precision: (R, R) the current precision of the modes.
            used: (P,) true for poses that must not be taken again.
            limit: the largest number of poses.
        """
        weight, remaining, chosen = self._weight(), ~used, list[int]()
        while (
            len(chosen) < limit
            and remaining.any()
            and np.trace(weight @ np.linalg.inv(precision)) > target**2
        ):
            candidates = np.flatnonzero(remaining)
            covariances = np.linalg.inv(precision + self.information[candidates])
            best = int(candidates[np.einsum("prs,sr->p", covariances, weight).argmin()])
            chosen.append(best)
            remaining[best] = False
            precision = precision + self.information[best]
        return chosen

    def _weight(self) -> Array:
        """Return the (R, R) matrix whose product with a covariance has the mean variance as its
        trace.
        """
        derivatives = self._position_derivatives()
        rows = derivatives[np.isfinite(derivatives[..., 0, 0])]  # (n, 2, R)
        return np.asarray(np.einsum("nbr,nbs->rs", rows, rows) / len(rows))

    def _position_derivatives(self) -> Array:
        """Return the (h, w, D, 2, R) px derivatives of the undistorted positions by the modes."""
        powers = np.stack([np.ones_like(self.depths), 1 / self.depths])  # (2, D)
        return np.asarray(np.einsum("hwabr,ad->hwdbr", self.spread, powers))
