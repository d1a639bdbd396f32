"""Which of the markers that were read are one board's: those that lie where their neighbours say.

A marker may be read wrongly: of Kalibr's tags, one in twenty was. Each one's four corners say
    roughly where its neighbours are, through
any lens; two that agree on each other are linked, and what hangs together is one board.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.markers import Markers

Floats = NDArray[np.float64]

NEIGHBOURS = 2.3  # pitches
APART = 0.4  # of a marker's side: how far a neighbour may be from where it is said to be


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """The groups of markers that hang together, the largest first."""

    groups: tuple[NDArray[np.intp], ...]

    @staticmethod
    def of(markers: Markers, places: Floats, pitch: float) -> "Links":
        """M markers, which ought to be at (M, 4, 2) m of the board; `pitch` is the distance of
        neighbours, m.
        """
        count = len(markers.numbers)
        middles, centres = places.mean(1), markers.corners.mean(1)
        turned = np.linalg.pinv(places - middles[:, None]) @ (
            markers.corners - centres[:, None]
        )  # (M, 2, 2) px for each m, transposed
        apart = (
            places[None] - middles[:, None, None]
        )  # (M, M, 4, 2): the second's corners from the first's middle
        said = np.einsum("mnkc,mcd->mnkd", apart, turned) + centres[:, None, None]
        off = np.linalg.norm(said - markers.corners[None], axis=-1).max(-1)
        sides = np.minimum(markers.sides[:, None], markers.sides[None])
        near = np.linalg.norm(middles[:, None] - middles[None], axis=-1) <= NEIGHBOURS * pitch
        agree = near & (off <= APART * sides) & (APART * sides >= off.T)
        agree |= np.eye(count, dtype=bool)
        labels = np.arange(count)
        while not np.array_equal(labels, least := np.where(agree, labels, count).min(1)):
            labels = least
        groups = sorted(
            (np.flatnonzero(labels == label) for label in np.unique(labels)), key=len, reverse=True
        )
        return Links(_joined(groups, markers, places))


def _joined(
    groups: list[NDArray[np.intp]], markers: Markers, places: Floats
) -> tuple[NDArray[np.intp], ...]:
    """Those that are one board with something in front of its middle are one group: a homography
    holds for both.
    """
    joined: list[NDArray[np.intp]] = []
    for group in groups:
        both = np.concatenate([joined[0], group]) if joined else group
        if joined and len(group) > 1 and _on_one_plane(places[both], markers.some(both)):
            joined[0] = np.sort(both)
        else:
            joined.append(group)
    return tuple(joined)


def _on_one_plane(places: Floats, markers: Markers) -> bool:
    mapping = cv2.findHomography(places.reshape(-1, 2), markers.corners.reshape(-1, 2))[0]
    if mapping is None:
        return False
    said = cv2.perspectiveTransform(places.reshape(-1, 1, 2), mapping).reshape(-1, 4, 2)
    return bool(
        (np.linalg.norm(said - markers.corners, axis=-1).max(1) <= APART * markers.sides).all()
    )
