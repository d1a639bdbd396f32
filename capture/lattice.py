"""Saddles -> the checkerboard they belong to, or the part of it that is in the picture.

Two saddles are neighbours if each is the nearest opposite one along an edge of the other. Counting squares from neighbour to neighbour
gives every saddle a column and a row. Only the sides of whole squares are counted along, for clutter seldom makes a square. A corner that
glare or a finger hides does not stop the count: it goes round.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.saddles import Saddles

OPPOSITE = -0.6  # cosine between second derivatives: perspective and uneven light keep those of neighbours below -0.8
AHEAD = 0.96  # cosine between an edge and the way to its other end: 16 degrees, for bent edges and the grain of pixels
NEARBY = 24  # saddles, among which a neighbour is looked for: twelve are as near as that in a board tilted to a third of its height
LEAST = 9  # saddles: texture makes smaller groups by chance


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Saddles in columns and rows."""

    points: NDArray[np.float64]
    """(rows, columns, 2) px, NaN where no saddle was found."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(rows, columns)."""
        return np.isfinite(self.points[..., 0])


def find_lattice(saddles: Saddles) -> Lattice | None:
    """The largest there is, with at least LEAST saddles."""
    if len(saddles.points) < LEAST:
        return None
    neighbours, turns = _neighbours(saddles)
    neighbour, turned = _of_squares(neighbours, turns).tolist(), turns.tolist()
    best: dict[int, tuple[int, int]] = {}
    left = {saddle for saddle, edges in enumerate(neighbour) if max(edges) >= 0}
    while len(left) > len(best):
        group = _count(next(iter(left)), neighbour, turned)
        left -= group.keys()
        best = max(best, group, key=len)
    if len(best) < LEAST:
        return None
    cells = np.array(list(best.values()))
    cells -= cells.min(0)
    points = np.full((*cells.max(0) + 1, 2), np.nan)
    points[cells[:, 0], cells[:, 1]] = saddles.points[list(best)]
    return Lattice(points)


def _neighbours(saddles: Saddles) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(n, 4) each, by saddle and edge: the neighbour, -1 for none; and by how many of its edges the neighbour's count is turned."""
    points, edges = saddles.points, saddles.edges
    x, y = points.T.astype(np.float32)
    squared = np.square(x[:, None] - x) + np.square(y[:, None] - y)
    other = np.argpartition(squared, min(NEARBY, len(points) - 1), axis=1)[:, : NEARBY + 1]  # itself among them
    far = np.sqrt(np.take_along_axis(squared, other, 1))[..., None]
    way = points[other] - points[:, None]  # (i, j, 2)
    opposite = saddles.bends[other] @ saddles.bends[..., None] < OPPOSITE  # (i, j, 1)
    ahead = way @ edges.swapaxes(1, 2) > AHEAD * far  # (i, j, edge)
    distance = np.where(ahead & opposite, far, np.inf)
    nearest = np.take_along_axis(other, distance.argmin(1), 1)  # (i, edge)
    nearest[~np.isfinite(distance.min(1))] = -1
    arriving = np.einsum("ikx,ikmx->ikm", edges, edges[nearest]).argmax(-1)  # the neighbour's edge that goes on in the same direction
    back = nearest[nearest, (arriving + 2) % 4]
    mutual = (nearest >= 0) & (back == np.arange(len(points))[:, None])
    return np.where(mutual, nearest, -1), (arriving - np.arange(4)) % 4


def _of_squares(neighbour: NDArray[np.intp], turned: NDArray[np.intp]) -> NDArray[np.intp]:
    """The neighbours, less those that are not joined by a side of a whole square."""
    start, first = np.indices(neighbour.shape)
    closed = np.zeros(neighbour.shape, bool)
    for turn in (1, 3):
        here, edge = start, first
        whole = np.ones(neighbour.shape, bool)
        for _ in range(4):
            there = neighbour[here, edge]
            whole &= there >= 0
            here, edge = there, (edge + turned[here, edge] + turn) % 4
        closed |= whole & (here == start)
    return np.where(closed, neighbour, -1)


def _count(start: int, neighbour: list[list[int]], turned: list[list[int]]) -> dict[int, tuple[int, int]]:
    """Row and column of every saddle that is reached from the first. A place belongs to the one that comes to it first."""
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    cells, taken, turns = {start: (0, 0)}, {(0, 0)}, {start: 0}
    ahead = deque([start])
    while ahead:
        here = ahead.popleft()
        row, column = cells[here]
        for edge in range(4):
            there = neighbour[here][edge]
            down, along = steps[(edge - turns[here]) % 4]
            place = row + down, column + along
            if there >= 0 and there not in cells and place not in taken:
                cells[there], turns[there] = place, (turns[here] + turned[here][edge]) % 4
                taken.add(place)
                ahead.append(there)
    return cells
