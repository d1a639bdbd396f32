"""The result of locating tags in a picture: the poses of tags with their covariances, and the
reasons why other tags have none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.corners.ink_spread import InkSpread

Array = NDArray[np.float64]

MIN_PROBABILITY = 0.99
"""A tag is ambiguous if the probability of its best pose is less."""


class UnplacedReason(StrEnum):
    """The reason why a tag that was read has no pose."""

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
    """T_camera_tag. In the tag's frame, x points to the right of the upright tag, y down, and z
    away from the viewer; the origin is the tag's middle.
    """

    turn: Array
    """(3, 3)"""
    position: Array
    """(3,) m"""
    noise: Array
    """(6, 6) covariance from the noise of the tag's corners: of a small turn about the camera's
    axes (rad), then of the position (m).
    """
    shared: Array
    """(6, S + 1) errors for each of S independent errors of unit variance of the calibration's
    rays, which all tags share, and for the error of the tags' side.
    """
    off_px: float
    """The root mean square distance of the tag's corners from those of a square at this pose."""
    probability: float
    """The probability of this pose against the other pose that the same corners allow."""

    @property
    def covariance(self) -> Array:
        """The (6, 6) covariance of the turn (rad) and the position (m), as in `noise`."""
        return np.asarray(self.noise + self.shared @ self.shared.T)

    @property
    def sigma(self) -> Array:
        """The (6,) standard deviations of the turn (rad) and the position (m)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def rotation(self) -> Array:
        """The (3,) rad rotation vector."""
        return np.asarray(Rotation.from_matrix(self.turn).as_rotvec())

    @property
    def quaternion(self) -> Array:
        """The (4,) quaternion: x, y, z, w."""
        return np.asarray(Rotation.from_matrix(self.turn).as_quat(canonical=True))

    def rotate(self, rotation: Array) -> TagPose:
        """Return the pose in another frame with the same origin; the (3, 3) rotation leads to
        that frame.
        """
        block = np.kron(np.eye(2), rotation)
        return replace(
            self,
            turn=rotation @ self.turn,
            position=rotation @ self.position,
            noise=block @ self.noise @ block.T,
            shared=block @ self.shared,
        )

    def distance(self, tag: TagPose) -> tuple[float, float]:
        """Return the distance in m from this tag's middle to another tag's in the same frame, and
        its sigma. Errors that move both tags equally do not count.
        """
        offset = tag.position - self.position
        length = float(np.linalg.norm(offset))
        direction = offset / length if length else np.full(3, 3**-0.5)
        variance = direction @ (self.noise + tag.noise)[3:, 3:] @ direction
        return length, float(
            np.sqrt(variance + ((direction @ (tag.shared - self.shared)[3:]) ** 2).sum())
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A tag with a pose."""

    number: int
    corners: Array
    """(4, 2) px: upper left, upper right, lower right, lower left of the upright tag."""
    poses: tuple[TagPose, ...]
    """The poses that the corners allow, one or two, the most probable first."""

    @property
    def ambiguous(self) -> bool:
        """True if the corners do not determine which of two poses the tag has."""
        return self.poses[0].probability < MIN_PROBABILITY


@dataclass(frozen=True, slots=True)
class Unplaced:
    """A tag that was read and has no pose."""

    number: int
    reason: UnplacedReason


@dataclass(frozen=True, slots=True)
class LocatedTags:
    """The tags of one picture."""

    tags: tuple[Tag, ...]
    """The tags with a pose, in the order of their numbers."""
    unplaced: tuple[Unplaced, ...]
    growth: InkSpread
    """The ink spread that was removed from the corners: black looked larger by it. 0 if it was not
    significant.
    """
