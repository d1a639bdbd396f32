"""Find saddles of the brightness: the places of a picture that look like an inner corner of a
checkerboard.

Where two edges cross, the brightness has a saddle, and a ring around it is dark, light, dark,
light. The two corners at the ends of a square's side have opposite second derivatives, because
black and white are exchanged between them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SMOOTHING = 1.0  # px: it removes noise, but keeps the corners of squares of 5 px apart
# of the strongest saddles. The strength is the square of the contrast: this is a fifth of the
# contrast.
MIN_STRENGTH = 0.04
RING_RADIUS = 3.0  # px, of the ring that must be dark, light, dark, light
RING_SAMPLES = 16
RING_CONTRAST = 8.0  # grey levels between dark and light: four times a small sensor's noise
RING_BATCH = 10_000  # saddles whose rings are sampled in one call


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """n saddles, the strongest first."""

    points: NDArray[np.float64]
    """(n, 2) px, at whole pixels."""
    curvatures: NDArray[np.float64]
    """(n, 3) second derivatives xx, sqrt 2 * xy, yy, scaled to length 1: the product of two rows is
    -1 for opposite saddles.
    """
    edges: NDArray[np.float64]
    """(n, 4, 2) unit directions away from the saddle along its edges, in order around the
    saddle.
    """


def find_saddles(grey: NDArray[np.uint8], limit: int) -> Saddles:
    """Return the strongest saddles of a (H, W) picture, at most `limit`."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTHING)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2)
    strength = np.asarray(cv2.subtract(cv2.multiply(xy, xy), cv2.multiply(xx, yy)))
    peaks = np.flatnonzero(
        (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 0)
    )
    order = np.argsort(-strength.flat[peaks])[: 4 * limit]
    peaks = peaks[order]
    strongest = strength.flat[
        peaks[len(peaks) // 20 : len(peaks) // 20 + 1]
    ]  # a few glints do not count
    y, x = np.unravel_index(
        peaks[strength.flat[peaks] > MIN_STRENGTH * strongest.sum()], strength.shape
    )
    points = np.stack([x, y], -1)
    edges, crossed = _edges(smooth, points)
    points, edges = points[crossed][:limit], edges[crossed][:limit]
    curvatures = np.stack(
        [
            derivative[points[:, 1], points[:, 0]].astype(np.float64)
            for derivative in (xx, xy * 2**0.5, yy)
        ],
        -1,
    )
    return Saddles(
        points.astype(np.float64),
        curvatures / np.linalg.norm(curvatures, axis=-1, keepdims=True),
        edges,
    )


def _edges(smooth: NDArray, points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return (n, 4, 2), the directions in which a ring around each of (n, 2) px changes between
    dark and light, and (n,), true where there are four such changes.

    The second derivative's principal directions are not used: they are biased towards a right angle
    where a board is tilted.
    """
    batches = np.split(points, range(RING_BATCH, len(points), RING_BATCH))
    results = [_batch_edges(smooth, batch) for batch in batches]
    return (
        np.concatenate([edges for edges, _ in results]),
        np.concatenate([crossed for _, crossed in results]),
    )


def _batch_edges(smooth: NDArray, points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the same for fewer than 32,767 points, the limit of one call of OpenCV."""
    if not len(points):
        return np.empty((0, 4, 2)), np.empty(0, np.bool_)
    angles = np.arange(RING_SAMPLES) * 2 * np.pi / RING_SAMPLES
    ring = (points[:, None] + RING_RADIUS * np.stack([np.cos(angles), np.sin(angles)], -1)).astype(
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
    saddle, sample = np.nonzero(changes & crossed[:, None])
    level = light[saddle, sample]
    next_level = following[saddle, sample]
    angle = (sample + level / (level - next_level)) * 2 * np.pi / RING_SAMPLES
    edges = np.zeros((len(points), 4, 2))
    edges[crossed] = np.stack([np.cos(angle), np.sin(angle)], -1).reshape(-1, 4, 2)
    return edges, crossed
