"""Group the markers that were read into boards by their positions relative to their neighbours.

A marker may be read wrongly: one in twenty of Kalibr's tags was. The four corners of a marker
predict roughly where its neighbours are, through any lens. Two markers that predict each other are
linked, and linked markers form one board.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.markers import Markers

Floats = NDArray[np.float64]

NEIGHBOUR_RADIUS = 2.3  # pitches
MAX_DEVIATION = 0.4  # of a marker's side: from the predicted place to the marker


def group_markers(markers: Markers, places: Floats, pitch: float) -> tuple[NDArray[np.intp], ...]:
    """Return the groups of linked markers, the largest first, as indices into `markers`.

    Args:
        markers: M markers.
        places: (M, 4, 2) m, where the board has their corners.
        pitch: m, the distance of neighbouring markers.
    """
    count = len(markers.numbers)
    middles = places.mean(1)
    centres = markers.corners.mean(1)
    # (M, 2, 2) px per m, transposed: each marker's own linear map
    linear_maps = np.linalg.pinv(places - middles[:, None]) @ (markers.corners - centres[:, None])
    # (M, M, 4, 2) m: the second marker's corners from the first one's middle
    offsets = places[None] - middles[:, None, None]
    predicted = np.einsum("mnkc,mcd->mnkd", offsets, linear_maps) + centres[:, None, None]
    deviation = np.linalg.norm(predicted - markers.corners[None], axis=-1).max(-1)
    sides = np.minimum(markers.sides[:, None], markers.sides[None])
    near = np.linalg.norm(middles[:, None] - middles[None], axis=-1) <= NEIGHBOUR_RADIUS * pitch
    linked = near & (deviation <= MAX_DEVIATION * sides) & (MAX_DEVIATION * sides >= deviation.T)
    linked |= np.eye(count, dtype=bool)
    labels = np.arange(count)
    while not np.array_equal(labels, lowest := np.where(linked, labels, count).min(1)):
        labels = lowest
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    return _join_groups(sorted(groups, key=len, reverse=True), markers, places)


def _join_groups(
    groups: list[NDArray[np.intp]], markers: Markers, places: Floats
) -> tuple[NDArray[np.intp], ...]:
    """Join groups to the largest one if a homography holds for both: they are one board, and
    something covers its middle.
    """
    joined: list[NDArray[np.intp]] = []
    for group in groups:
        union = np.concatenate([joined[0], group]) if joined else group
        if joined and len(group) > 1 and _on_one_plane(places[union], markers.select(union)):
            joined[0] = np.sort(union)
        else:
            joined.append(group)
    return tuple(joined)


def _on_one_plane(places: Floats, markers: Markers) -> bool:
    """True if one homography maps all markers from the board to the picture."""
    mapping = cv2.findHomography(places.reshape(-1, 2), markers.corners.reshape(-1, 2))[0]
    if mapping is None:
        return False
    predicted = cv2.perspectiveTransform(places.reshape(-1, 1, 2), mapping).reshape(-1, 4, 2)
    return bool(
        (
            np.linalg.norm(predicted - markers.corners, axis=-1).max(1)
            <= MAX_DEVIATION * markers.sides
        ).all()
    )
