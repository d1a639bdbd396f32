"""Instructions for holding the board: "closer, to the left edge, tilt the right side away". Sides
are those of the picture.

For a board with markers the place may be "over the left edge (a part outside)".
"""

import cv2
import numpy as np
from numpy.typing import NDArray

MIN_DISTANCE_RATIO = 1.15
"""A smaller ratio of distances is not worth a word."""
EDGE = 0.2
"""A fraction of the picture's width or height: a board nearer than this to one side, and not to the
other, is at that side.
"""
MIN_TILT = np.radians(12)
"""rad: a smaller tilt is not worth a word."""

PLACES = (
    ("the top left corner", "the top edge", "the top right corner"),
    ("the left edge", "", "the right edge"),
    ("the bottom left corner", "the bottom edge", "the bottom right corner"),
)


def placement_hint(
    pose: NDArray,
    outline: NDArray,
    size: tuple[int, int],
    present: NDArray | None,
    reach: tuple[float, float],
) -> str:
    """Return the instruction, in the order distance, place, tilt.

    Args:
        pose: (6,) the requested pose of the board: rotation vector (rad) and translation (m).
        outline: (N, 2) px of the board's outline in that pose.
        size: px, width and height of the picture.
        present: (6,) the current pose of the board; None if it is unknown.
        reach: m, the nearest and the farthest depth of all requests.
    """
    phrases = [_distance(pose[5], present, reach), _place(outline, size), _tilt(pose)]
    return ", ".join(filter(None, phrases))


def tilt_of(pose: NDArray) -> tuple[int, int]:
    """Return the sides that are clearly tilted away from the camera, whatever the board's rotation
    in its own plane.

    Returns:
        -1 for the left, 1 for the right, 0 for neither; and -1 for the top, 1 for the bottom, 0 for
        neither.
    """
    normal = cv2.Rodrigues(np.asarray(pose[:3], np.float64))[0][:, 2]
    # rad: the slope of the depth to the right and downwards.
    slope_x, slope_y = np.arctan(-normal[:2] / normal[2])
    horizontal = int(np.sign(slope_x)) * (abs(slope_x) > MIN_TILT)
    vertical = int(np.sign(slope_y)) * (abs(slope_y) > MIN_TILT)
    return horizontal, vertical


def _tilt(pose: NDArray) -> str:
    horizontal, vertical = tilt_of(pose)
    names = ("", "bottom", "top")[vertical], ("", "right", "left")[horizontal]
    side = " ".join(filter(None, names))
    if not side:
        return "facing the camera"
    return f"tilt the {side} {'corner' if horizontal and vertical else 'side'} away"


def _distance(depth: float, present: NDArray | None, reach: tuple[float, float]) -> str:
    if present is not None:
        ratio = depth / present[5]
        return (
            "closer"
            if ratio < 1 / MIN_DISTANCE_RATIO
            else "farther away"
            if ratio > MIN_DISTANCE_RATIO
            else ""
        )
    middle = np.sqrt(reach[0] * reach[1])
    where = (
        "near"
        if depth < middle / MIN_DISTANCE_RATIO
        else "far"
        if depth > middle * MIN_DISTANCE_RATIO
        else "at a middle distance"
    )
    return f"{where} ({depth:.1f} m)" if depth >= 1 else f"{where} ({100 * depth:.0f} cm)"


def _place(outline: NDArray, size: tuple[int, int]) -> str:
    indices, overlaps = [], False
    for low, high, length in zip(outline.min(0), outline.max(0), size, strict=True):
        low_margin, high_margin = low / length, 1 - high / length
        if low_margin < EDGE and low_margin < high_margin - abs(high_margin) / 2:
            indices.append(0)
        elif high_margin < EDGE and high_margin < low_margin - abs(low_margin) / 2:
            indices.append(2)
        else:
            indices.append(1)
        overlaps |= min(low_margin, high_margin) < 0
    place = PLACES[indices[1]][indices[0]]
    if overlaps:
        return f"over {place} (a part outside)" if place else "in the middle (parts outside)"
    return f"to {place}" if place else "in the middle"
