"""A depth picture from one picture of each camera of a pair.

OpenCV's semi-global matching finds the pixels of the second rectified picture that look like those
of the first. Each match is then triangulated from the two pixels of the original pictures, through
lens and glass: the disparity is used for matching alone.

Source: H. Hirschmueller, Stereo processing by semiglobal matching and mutual information (2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from calib.errors import InputError
from calib.rig.feature_matches import FeatureMatches, PairAgreement, match_features
from calib.rig.rectify import Map, RectifiedPair
from calib.rig.rig import Rig
from calib.undistortion.remap import remap

BLOCK = 5
"""px: the side of the block that is compared."""
MAX_DISPARITIES = 1024
"""px: the largest range of disparities that is searched."""
MATCH_NOISE_PX = 0.25
"""px: the standard deviation of a match, from OpenCV's interpolation of disparities, which it gives
in sixteenths.
"""
SIGMA_POINTS = 2000
"""Matches at which sigma is computed; the others take that of the nearest one, scaled by the square
of the depth.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DepthPicture:
    """Depths in the frame of the first rectified picture."""

    depth: NDArray[np.float32]
    """(height, width) m along the axis of the rectified pinhole; NaN without a match."""
    sigma: NDArray[np.float32]
    """(height, width) m, its standard deviation, from the match's noise and the calibration."""
    points: Array
    """(N, 3) m, the matches in the reference's frame, row by row."""
    features: FeatureMatches
    """Whether the two pictures belong together."""

    @property
    def is_swapped(self) -> bool:
        """True if the pictures match in the other order."""
        return self.features.agreement is PairAgreement.SWAPPED


def depth_picture(
    rig: Rig,
    pair: RectifiedPair,
    pictures: tuple[NDArray, NDArray],
    depths: tuple[float, float],
    noise_px: float = MATCH_NOISE_PX,
) -> DepthPicture:
    """Return the depth picture of a pair of pictures.

    Args:
        rig: the calibrated rig.
        pair: its rectification.
        pictures: (height, width) or (height, width, 3) pixels of the left and right camera, of 8
            or 16 bits.
        depths: m, the nearest and the farthest depth that is searched.
        noise_px: the standard deviation of a match.

    Raises:
        InputError: a picture has another size than the camera, both are the same picture, or the
            range is too wide.
    """
    for name, picture in zip(pair.names, pictures, strict=True):
        camera = rig.calibrations[name].camera
        if picture.shape[:2] != (camera.height, camera.width):
            raise InputError(
                f"The picture of {name} is {picture.shape[1]}x{picture.shape[0]} px and the"
                f" calibration for {camera.width}x{camera.height}."
            )
    if np.array_equal(*pictures):
        raise InputError(
            f"Both pictures are the same: give one of {pair.names[0]} and one of {pair.names[1]},"
            " taken at the same time."
        )
    eight_bits = _eight_bits(pictures[0]), _eight_bits(pictures[1])
    disparity = _match(eight_bits, pair, depths)
    rows, columns = np.nonzero(np.isfinite(disparity))
    shape = disparity.shape
    depth = np.full(shape, np.nan, np.float32)
    sigma = np.full(shape, np.nan, np.float32)
    first = np.column_stack([columns, rows]).astype(np.float64)
    second = first - disparity[rows, columns][:, None] * np.array([1.0, 0.0])
    pixels = {
        name: _source(places, maps)
        for name, places, maps in zip(pair.names, (first, second), pair.maps, strict=True)
    }
    points = rig.points(pixels)
    axial = (points - pair.centres[0]) @ pair.rotation[2]
    near, far = depths
    is_matched = np.isfinite(axial) & (axial >= near) & (axial <= far)
    depth[rows[is_matched], columns[is_matched]] = axial[is_matched]
    sample = np.flatnonzero(is_matched)[:: max(1, int(is_matched.sum()) // SIGMA_POINTS)]
    if len(sample):
        chosen = {name: places[sample] for name, places in pixels.items()}
        _, covariance = rig.triangulate(chosen, noise_px)
        axis = pair.rotation[2]
        relative = np.sqrt(np.einsum("i,nij,j->n", axis, covariance, axis)) / axial[sample] ** 2
        relative_sigma = np.zeros(shape, np.float64)
        relative_sigma[rows[sample], columns[sample]] = relative
        nearest = _nearest(relative_sigma)
        sigma = np.where(np.isfinite(depth), nearest * depth**2, np.nan).astype(np.float32)
    features = match_features(rig, pair.names, eight_bits)
    return DepthPicture(depth, sigma, points[is_matched], features)


def _eight_bits(picture: NDArray) -> NDArray[np.uint8]:
    return picture if picture.dtype == np.uint8 else (picture // 257).astype(np.uint8)


def _match(
    pictures: Sequence[NDArray[np.uint8]], pair: RectifiedPair, depths: tuple[float, float]
) -> NDArray[np.float32]:
    """Return the (height, width) px by which each pixel of the first rectified picture lies farther
    right than its match in the second; NaN without one.
    """
    rectified: list[NDArray[np.uint8]] = []
    for picture, (map_x, map_y) in zip(pictures, pair.maps, strict=True):
        rectified.append(remap(picture, map_x, map_y, cv2.INTER_CUBIC, cv2.BORDER_CONSTANT))
    near, far = depths
    lowest = int(np.floor(pair.focal * pair.baseline / far)) - 1
    highest = int(np.ceil(pair.focal * pair.baseline / near)) + 1
    count = 16 * -(-(highest - lowest) // 16)
    if count > min(MAX_DISPARITIES, rectified[0].shape[1]):
        raise InputError(
            f"Depths from {near:g} to {far:g} m span {count} px of disparity: search a smaller"
            " range of depths."
        )
    channels = rectified[0].shape[2] if rectified[0].ndim == 3 else 1
    matcher = cv2.StereoSGBM.create(
        minDisparity=lowest,
        numDisparities=count,
        blockSize=BLOCK,
        P1=8 * channels * BLOCK**2,
        P2=32 * channels * BLOCK**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    # A margin, so that the leftmost pixels have all disparities to search.
    margin = max(0, lowest + count)
    padded = [
        cv2.copyMakeBorder(picture, 0, 0, margin, 0, cv2.BORDER_REPLICATE) for picture in rectified
    ]
    disparity = matcher.compute(*padded)[:, margin:].astype(np.float32) / 16
    is_matched = (pair.maps[0][0] >= 0) & (disparity >= lowest)
    return np.where(is_matched, disparity, np.float32(np.nan))


def _source(places: Array, maps: Map) -> Array:
    """Return the (N, 2) px of the original picture that rectified (N, 2) px show; NaN where none is
    shown.
    """
    at = places.T[::-1]  # rows, columns
    coverage = map_coordinates((maps[0] >= 0).astype(np.float64), at, order=1, cval=0.0)
    sources = [map_coordinates(values.astype(np.float64), at, order=1) for values in maps]
    shown = (coverage > 1 - 1e-6)[:, None]
    return np.where(shown, np.column_stack(sources), np.nan)


def _nearest(relative_sigma: Array) -> Array:
    """Return the (h, w) picture with the nearest value that is not zero at each pixel."""
    places = distance_transform_edt(
        relative_sigma == 0, return_distances=False, return_indices=True
    )
    return np.asarray(relative_sigma[tuple(places)])
