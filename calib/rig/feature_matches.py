"""Whether two pictures belong together: features that look alike in both, compared with the rig.

The two pixels of a true match project to one point: the triangulated point lies within a few pixels
of both. In swapped pictures the rays of nearly all matches do not meet before the cameras, and in
pictures of different moments the few features that look alike are chance. Dense matching does not
tell, because it finds a match along the row for a part of the pixels of any two pictures.

Source: D. Lowe, Distinctive image features from scale-invariant keypoints (2004), for the features
and the ratio test.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.rig.rig import Rig

MAX_FEATURES = 2000
FEATURE_WIDTH = 1000
"""px: wider pictures are reduced to this width to find features, which saves seconds."""
LIKENESS_RATIO = 0.8
"""Lowe's ratio: the second best match must differ by so much more than the best one."""
ERROR_SHARE = 1 / 400
"""The largest reprojection error of a match that agrees with the rig, as a share of the picture's
width: 2 px at a width of 800 px.
"""
MIN_MATCHES = 12
"""Fewer matches do not tell whether the pictures belong together."""
DOUBTFUL_SHARE = 0.15
"""The share of agreeing matches below which the pictures do not belong together. Of chance matches
1 % agree; of true ones at least 30 %, on the rendered rigs.
"""

Array = NDArray[np.float64]


class PairAgreement(Enum):
    """Whether two pictures belong together."""

    AGREES = "agrees"
    SWAPPED = "swapped"
    """The matches agree with the rig if the two pictures change places."""
    DISAGREES = "disagrees"
    UNDECIDED = "undecided"
    """There are too few matches."""


@dataclass(frozen=True, slots=True)
class FeatureMatches:
    """Features that look alike in the two pictures of a pair."""

    matches: int
    agreeing: int
    """Matches that agree with the rig."""
    agreeing_swapped: int
    """Matches that agree with the rig if the two pictures change places."""

    @property
    def agreement(self) -> PairAgreement:
        if self.matches < MIN_MATCHES:
            return PairAgreement.UNDECIDED
        if self.agreeing >= DOUBTFUL_SHARE * self.matches:
            return PairAgreement.AGREES
        if self.agreeing_swapped >= DOUBTFUL_SHARE * self.matches:
            return PairAgreement.SWAPPED
        return PairAgreement.DISAGREES


def match_features(
    rig: Rig, names: tuple[str, str], pictures: tuple[NDArray[np.uint8], NDArray[np.uint8]]
) -> FeatureMatches:
    """Return how many features of two pictures look alike, and how many of them agree with the rig.

    Args:
        rig: the calibrated rig.
        names: the camera of each picture.
        pictures: (height, width) or (height, width, 3) pixels, as the cameras recorded them.
    """
    first, second = _matching_features(*pictures)
    tolerance = ERROR_SHARE * pictures[0].shape[1]
    return FeatureMatches(
        matches=len(first),
        agreeing=_agreeing(rig, {names[0]: first, names[1]: second}, tolerance),
        agreeing_swapped=_agreeing(rig, {names[1]: first, names[0]: second}, tolerance),
    )


def _agreeing(rig: Rig, pixels: Mapping[str, Array], tolerance: float) -> int:
    """Return how many matches have a point whose projections lie within `tolerance` px."""
    points = rig.points(pixels)
    is_point = np.isfinite(points).all(-1)
    if not is_point.any():
        return 0
    projected = rig.project(points[is_point])
    errors = [
        np.linalg.norm(projected[name] - places[is_point], axis=-1)
        for name, places in pixels.items()
    ]
    return int((np.max(errors, axis=0) <= tolerance).sum())


def _matching_features(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Return the (M, 2) px of the features of two pictures that look alike, in either picture."""
    first_px, first_features = _features(first)
    second_px, second_features = _features(second)
    forward = _nearest_features(first_features, second_features)
    backward = _nearest_features(second_features, first_features)
    pairs = [(i, j) for i, j in forward.items() if backward.get(j) == i]
    places = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return first_px[places[:, 0]], second_px[places[:, 1]]


def _features(picture: NDArray[np.uint8]) -> tuple[Array, NDArray[np.float32]]:
    """Return the (N, 2) px of a picture's features and their (N, 128) descriptors."""
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = np.array(grey.shape[::-1])
    if size[0] > FEATURE_WIDTH:
        reduced = FEATURE_WIDTH, max(1, round(FEATURE_WIDTH * size[1] / size[0]))
        grey = cv2.resize(grey, reduced, interpolation=cv2.INTER_AREA)
    scale = size / grey.shape[::-1]
    points, descriptors = cv2.SIFT.create(MAX_FEATURES).detectAndCompute(grey, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    places = np.array([point.pt for point in points])
    return (places + 0.5) * scale - 0.5, descriptors.astype(np.float32)


def _nearest_features(
    queries: NDArray[np.float32], features: NDArray[np.float32]
) -> dict[int, int]:
    """Return, for each query that has one clearly best match, the index of that match."""
    if len(queries) == 0 or len(features) < 2:
        return {}
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(queries, features, k=2)
    return {
        best.queryIdx: best.trainIdx
        for best, second in nearest
        if best.distance < LIKENESS_RATIO * second.distance
    }
