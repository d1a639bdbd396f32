"""Which views to take: what each pose of a bank would add to what is known, and how sure the maps
would be. No torch.

The shared parameters of the fit (relief, freed parameters) stand here as modes: independent and
standard normal before the first view, and only those are kept that move the maps. In them, a view's
information is a matrix that adds up over views, and the predicted variance of an undistorted
position is a row of `spread` through the inverse of that sum.

Source: A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum experimental designs, with SAS (2007),
    chapter 10, for the mean predicted
variance as the criterion (I-optimality) and for choosing one view after the other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 40
"""Views that are looked ahead."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """What a bank of P poses tells of R modes, and what the modes do to the maps."""

    poses: Array
    """(P, 6) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(P, count, 2) px, where the camera sees the board's corners through the cover in each; NaN
    where it does not.
    """
    information: Array
    """(P, R, R) of each pose, the board's pose itself unknown."""
    seen: Array
    """(R, R) of the views that there are."""
    views: int
    """How many these are."""
    spread: Array
    """(h, w, 2, 2, R) px, px m: derivatives of A and B, x and y each, at pixels over the picture by
    the modes; the undistorted position at depth Z is A + B / Z. Rigid motion of all rays is taken
    out. NaN where no ray leaves the cover.
    """
    depths: Array
    """(D,) m, at which the maps are wanted."""
    glass: Array
    """(h, w, 2) where those pixels look through the glass: down and across its patch, each from 0
    to 1.
    """

    def known(self, more: Array | None = None) -> Array:
        """(R, R) precision of the modes: the prior, the views that there are, and the information
        of more.
        """
        return np.eye(len(self.seen)) + self.seen + (0 if more is None else more)

    def variance(self, known: Array) -> Array:
        """(h, w, D) px^2: predicted variance of the undistorted position, x and y together."""
        at = np.stack([np.ones_like(self.depths), 1 / self.depths])  # (2, D)
        moved = np.einsum("hwabr,ad->hwdbr", self.spread, at)
        root = np.linalg.inv(np.linalg.cholesky(known))
        return np.asarray(((moved @ root.T) ** 2).sum((-2, -1)))

    def sigma(self, known: Array) -> float:
        """px: the root of the mean of that over the picture and the depths."""
        return float(np.sqrt(np.nanmean(self.variance(known))))

    def plan(
        self, known: Array, used: NDArray[np.bool_], target: float, most: int = MOST
    ) -> list[int]:
        """The poses to take one after the other, each the one that lowers the mean variance most,
        until sigma is below a target in px.

        Args:
            known: (R, R) precision of the modes now.
            used: (P,) poses that are not to be taken again.
            most: how many at most.
        """
        weight, left, chosen = self._weight(), ~used, list[int]()
        while (
            len(chosen) < most
            and left.any()
            and np.trace(weight @ np.linalg.inv(known)) > target**2
        ):
            candidates = np.flatnonzero(left)
            after = np.linalg.inv(known + self.information[candidates])
            best = int(candidates[np.einsum("prs,sr->p", after, weight).argmin()])
            chosen.append(best)
            left[best] = False
            known = known + self.information[best]
        return chosen

    def _weight(self) -> Array:
        """(R, R) whose product with a covariance has the mean variance as its trace."""
        at = np.stack([np.ones_like(self.depths), 1 / self.depths])
        moved = np.einsum("hwabr,ad->hwdbr", self.spread, at)
        rows = moved[np.isfinite(moved[..., 0, 0])]  # (n, 2, R)
        return np.asarray(np.einsum("nbr,nbs->rs", rows, rows) / len(rows))
