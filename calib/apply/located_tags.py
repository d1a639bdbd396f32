"""What is known of tags that were located: places, turns, covariances, and why one is not
placed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.corners.ink_spread import InkSpread

Array = NDArray[np.float64]

SURE = 0.99
"""The least probability of a pose that is the only one."""


class Reason(StrEnum):
    """Why a tag that was read is not placed."""

    TWICE = "seen twice: show each number once"
    NO_RAY = (
        "no ray leaves the cover at one of its corners: move it towards the middle of the picture"
    )
    NO_EDGES = "its black square cannot be measured: show it larger, sharp and with a white margin"
    NO_SQUARE = (
        "its corners are not those of a flat square: show it flat and whole, and check the"
        " dictionary, the border and the calibration"
    )


@dataclass(frozen=True, slots=True, eq=False)
class TagPose:
    """T_camera_tag: x to the right of the upright tag, y down, z away from who looks at it; origin
    in its middle.
    """

    turn: Array
    """(3, 3)"""
    position: Array
    """(3,) m"""
    own: Array
    """(6, 6) covariance from the noise of its own corners: of a small turn about the camera's axes
    (rad), then of the position (m).
    """
    shared: Array
    """(6, S + 1) errors for each of S independent errors of unit variance of the calibration's
    rays, which all tags share, and for that of the tags' side.
    """
    off_px: float
    """Root mean square distance of its corners from those of a square there."""
    probability: float
    """Of this pose and not the other that the same corners allow."""

    @property
    def covariance(self) -> Array:
        """(6, 6) rad and m, of the turn and the position as in `own`."""
        return np.asarray(self.own + self.shared @ self.shared.T)

    @property
    def sigma(self) -> Array:
        """(6,) rad and m: standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def rotation(self) -> Array:
        """(3,) rad: the rotation vector."""
        return np.asarray(Rotation.from_matrix(self.turn).as_rotvec())

    @property
    def quaternion(self) -> Array:
        """(4,) x, y, z, w."""
        return np.asarray(Rotation.from_matrix(self.turn).as_quat(canonical=True))

    def rotate(self, turn: Array) -> TagPose:
        """Return the pose in another frame with the same origin; the (3, 3) rotation leads to
        that frame.
        """
        block = np.kron(np.eye(2), turn)
        return replace(
            self,
            turn=turn @ self.turn,
            position=turn @ self.position,
            own=block @ self.own @ block.T,
            shared=block @ self.shared,
        )

    def distance(self, other: TagPose) -> tuple[float, float]:
        """From one tag's middle to another's in the same frame, and its sigma, m.

        What moves both alike does not count.
        """
        apart = other.position - self.position
        metres = float(np.linalg.norm(apart))
        along = apart / metres if metres else np.full(3, 3**-0.5)
        own = along @ (self.own + other.own)[3:, 3:] @ along
        return metres, float(np.sqrt(own + ((along @ (other.shared - self.shared)[3:]) ** 2).sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A tag that was placed."""

    number: int
    corners: Array
    """(4, 2) px: upper left, upper right, lower right, lower left of the upright tag."""
    poses: tuple[TagPose, ...]
    """The most probable first; a second one where the corners allow it at all."""

    @property
    def ambiguous(self) -> bool:
        """Whether its corners do not tell which of two poses it has."""
        return self.poses[0].probability < SURE


@dataclass(frozen=True, slots=True)
class Unplaced:
    """A tag that was read, and is not placed."""

    number: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class Located:
    """What one picture shows."""

    tags: tuple[Tag, ...]
    """By number."""
    unplaced: tuple[Unplaced, ...]
    growth: InkSpread
    """By how much black looked larger than it is, and corners were corrected; 0 where it did not.
    """
