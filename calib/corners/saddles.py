"""Where two edges cross: the places of a picture that look like an inner corner of a checkerboard.

The brightness has a saddle there, and a ring around it is dark, light, dark, light. The two corners
at the ends of a square's side have opposite second derivatives, for black and white change places
between them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SMOOTH = 1.0  # px: noise goes, and the corners of squares of 5 px stay apart
# of the strongest saddles, whose strength is the square of their contrast: a fifth of the contrast
FAINT = 0.04
RING = 3.0  # px, radius of the ring on which it must be dark, light, dark, light
SAMPLES = 16  # on the ring
RING_CONTRAST = 8.0  # grey levels between dark and light: four times a small sensor's noise
AT_ONCE = 10_000  # saddles, around which is looked


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """n saddles, the strongest first."""

    points: NDArray[np.float64]
    """(n, 2) px, to the pixel."""
    bends: NDArray[np.float64]
    """(n, 3) second derivatives xx, xy * sqrt 2, yy, scaled to length 1: the product of two rows is
    -1 for opposite saddles.
    """
    edges: NDArray[np.float64]
    """(n, 4, 2) unit, away from the saddle along the edges; each a turn in the same sense from the
    one before.
    """


def find_saddles(grey: NDArray[np.uint8], most: int) -> Saddles:
    """Of a (H, W) picture, not more than so many."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTH)
    xx, xy, yy = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((2, 0), (1, 1), (0, 2)))
    strength = np.asarray(cv2.subtract(cv2.multiply(xy, xy), cv2.multiply(xx, yy)))
    peaks = np.flatnonzero(
        (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 0)
    )
    order = np.argsort(-strength.flat[peaks])[: 4 * most]
    peaks = peaks[order]
    strongest = strength.flat[
        peaks[len(peaks) // 20 : len(peaks) // 20 + 1]
    ]  # a few glints do not count
    y, x = np.unravel_index(peaks[strength.flat[peaks] > FAINT * strongest.sum()], strength.shape)
    points = np.stack([x, y], -1)
    edges, crossed = _edges(smooth, points)
    points, edges = points[crossed][:most], edges[crossed][:most]
    bends = np.stack(
        [part[points[:, 1], points[:, 0]].astype(np.float64) for part in (xx, xy * 2**0.5, yy)], -1
    )
    return Saddles(
        points.astype(np.float64), bends / np.linalg.norm(bends, axis=-1, keepdims=True), edges
    )


def _edges(smooth: NDArray, points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(n, 4, 2) the directions in which a ring around each of (n, 2) px changes between dark and
    light, and (n,) whether those are four.

    The second derivative's own directions are drawn towards a right angle where a board is tilted.
    """
    parts = np.split(points, range(AT_ONCE, len(points), AT_ONCE))
    edges, crossed = zip(*(_some_edges(smooth, part) for part in parts), strict=True)
    return np.concatenate(edges), np.concatenate(crossed)


def _some_edges(smooth: NDArray, points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Of fewer than 32,767, which is what one call of OpenCV bears."""
    if not len(points):
        return np.empty((0, 4, 2)), np.empty(0, np.bool_)
    angles = np.arange(SAMPLES) * 2 * np.pi / SAMPLES
    ring = (points[:, None] + RING * np.stack([np.cos(angles), np.sin(angles)], -1)).astype(
        np.float32
    )
    light = cv2.remap(
        smooth, ring[..., 0], ring[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    low, high = light.min(1, keepdims=True), light.max(1, keepdims=True)
    light = light - (low + high) / 2
    following = np.roll(light, -1, 1)
    changes = (light > 0) != (following > 0)
    crossed = (changes.sum(1) == 4) & ((high - low)[:, 0] > RING_CONTRAST)
    who, sample = np.nonzero(changes & crossed[:, None])
    before, after = light[who, sample], following[who, sample]
    angle = (sample + before / (before - after)) * 2 * np.pi / SAMPLES
    edges = np.zeros((len(points), 4, 2))
    edges[crossed] = np.stack([np.cos(angle), np.sin(angle)], -1).reshape(-1, 4, 2)
    return edges, crossed
