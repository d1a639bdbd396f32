"""Where to hold the board, in words: "closer, to the left edge, tilt the right side away". Sides
are the picture's.

A board with markers may be wanted "over the left edge (a part outside)".
"""

import cv2
import numpy as np
from numpy.typing import NDArray

CLEARLY = 1.15  # times as far: less is not worth a word
# of the picture's width or height: a board that comes nearer to one side than this, and not to the
# other, is at that side
EDGE = 0.2
TILTED = np.radians(12)

PLACES = (
    ("the top left corner", "the top edge", "the top right corner"),
    ("the left edge", "", "the right edge"),
    ("the bottom left corner", "the bottom edge", "the bottom right corner"),
)


def words(
    pose: NDArray,
    outline: NDArray,
    size: tuple[int, int],
    present: NDArray | None,
    reach: tuple[float, float],
) -> str:
    """What to do, in the order distance, place, tilt.

    Args:
        pose: (6,) where the board is wanted: rotation vector (rad) and translation (m).
        outline: (N, 2) px of it there.
        size: px, width and height of the picture.
        present: (6,) where the board is now; None if that is not known.
        reach: m, the nearest and the farthest depth that is ever asked for.
    """
    said = [_distance(pose[5], present, reach), _place(outline, size), _tilt(pose)]
    return ", ".join(filter(None, said))


def tilt_of(pose: NDArray) -> tuple[int, int]:
    """Which side is clearly away from the camera, whichever way the board is turned in its own
    plane.

    Returns:
        -1 for the left, 1 for the right, 0 for neither; and -1 for the top, 1 for the bottom, 0 for
        neither.
    """
    normal = cv2.Rodrigues(np.asarray(pose[:3], np.float64))[0][:, 2]
    right, down = np.arctan(-normal[:2] / normal[2])  # rad: by how much depth grows that way
    return int(np.sign(right)) * (abs(right) > TILTED), int(np.sign(down)) * (abs(down) > TILTED)


def _tilt(pose: NDArray) -> str:
    across, down = tilt_of(pose)
    side = " ".join(filter(None, (("", "bottom", "top")[down], ("", "right", "left")[across])))
    if not side:
        return "facing the camera"
    return f"tilt the {side} {'corner' if across and down else 'side'} away"


def _distance(depth: float, present: NDArray | None, reach: tuple[float, float]) -> str:
    if present is not None:
        ratio = depth / present[5]
        return "closer" if ratio < 1 / CLEARLY else "farther away" if ratio > CLEARLY else ""
    middle = np.sqrt(reach[0] * reach[1])
    where = (
        "near"
        if depth < middle / CLEARLY
        else "far"
        if depth > middle * CLEARLY
        else "at a middle distance"
    )
    return f"{where} ({depth:.1f} m)" if depth >= 1 else f"{where} ({100 * depth:.0f} cm)"


def _place(outline: NDArray, size: tuple[int, int]) -> str:
    at, over = [], False
    for low, high, length in zip(outline.min(0), outline.max(0), size, strict=True):
        before, after = low / length, 1 - high / length
        at.append(
            0
            if before < EDGE and before < after - abs(after) / 2
            else 2
            if after < EDGE and after < before - abs(before) / 2
            else 1
        )
        over |= min(before, after) < 0
    place = PLACES[at[1]][at[0]]
    if over:
        return f"over {place} (a part outside)" if place else "in the middle (parts outside)"
    return f"to {place}" if place else "in the middle"
