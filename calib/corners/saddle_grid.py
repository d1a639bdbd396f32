"""Saddles -> the checkerboard they belong to, or the part of it that is in the picture.

Two saddles are neighbours if each is the nearest opposite one along an edge of the other. Counting
squares from neighbour to neighbour gives every saddle a column and a row. Only the sides of whole
squares are counted along, for clutter seldom makes a square. A corner that glare or a finger hides
does not stop the count: it goes round.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.saddles import Saddles, find_saddles
from calib.session.board import Board

OPPOSITE = (
    -0.6
    # cosine between second derivatives: perspective and uneven light keep those of neighbours below
    # -0.8
)
# cosine between an edge and the way to its other end: 16 degrees, for bent edges and the grain of
# pixels
AHEAD = 0.96
# saddles, among which a neighbour is looked for: twelve are as near as that in a board tilted to a
# third of its height
NEARBY = 24
LEAST = 9  # saddles: texture makes smaller groups by chance
CLUTTER = 300  # saddles besides the board's, stronger than the weakest of its corners
AT_ONCE = 256  # saddles, whose distances to all others are held


@dataclass(frozen=True, slots=True, eq=False)
class SaddleGrid:
    """Saddles in columns and rows."""

    points: NDArray[np.float64]
    """(rows, columns, 2) px, NaN where no saddle was found."""
    beside: "SaddleGrid | None" = None
    """The second largest in the picture."""

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(rows, columns)."""
        return np.isfinite(self.points[..., 0])

    def whole(self, board: Board) -> Iterator[NDArray[np.float64]]:
        """(count, 2) px, row by row, for each way in which the board may lie in it.

        A stray saddle at its rim does not matter; a line of them does, for then it is a part of
        another board.
        """
        for points in (self.points, self.points.swapaxes(0, 1)):
            seen = np.isfinite(points[..., 0])
            spare = seen.sum() - board.count
            if (
                seen.shape[0] < board.rows
                or seen.shape[1] < board.columns
                or spare > 0.5 * min(board.rows, board.columns)
            ):
                continue
            windows = np.lib.stride_tricks.sliding_window_view(
                seen, (board.rows, board.columns)
            ).all((-1, -2))
            row, column = np.unravel_index(windows.argmax(), windows.shape)
            if windows.any():
                yield points[row : row + board.rows, column : column + board.columns].reshape(-1, 2)


def find_grid(grey: NDArray[np.uint8], board: Board) -> SaddleGrid | None:
    """The largest in a (H, W) picture, if that is cluttered no more than where this board is
    shown.
    """
    return grid_of(find_saddles(grey, CLUTTER + board.count))


def grid_of(saddles: Saddles) -> SaddleGrid | None:
    """The largest there is, with at least LEAST saddles, and the one after it."""
    if len(saddles.points) < LEAST:
        return None
    neighbours, turns = _neighbours(saddles)
    neighbour, turned = _of_squares(neighbours, turns).tolist(), turns.tolist()
    best: list[dict[int, tuple[int, int]]] = [{}, {}]
    left = {saddle for saddle, edges in enumerate(neighbour) if max(edges) >= 0}
    while len(left) > max(len(best[1]), LEAST - 1):
        group = _count(next(iter(left)), neighbour, turned)
        left -= group.keys()
        best = sorted([*best, group], key=len, reverse=True)[:2]
    first, second = (_grid(saddles, group) for group in best)
    return replace(first, beside=second) if first else None


def _grid(saddles: Saddles, group: dict[int, tuple[int, int]]) -> SaddleGrid | None:
    if len(group) < LEAST:
        return None
    cells = np.array(list(group.values()))
    cells -= cells.min(0)
    points = np.full((*cells.max(0) + 1, 2), np.nan)
    points[cells[:, 0], cells[:, 1]] = saddles.points[list(group)]
    return SaddleGrid(points)


def _neighbours(saddles: Saddles) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(n, 4) each, by saddle and edge: the neighbour, -1 for none; and by how many of its edges the
    neighbour's count is turned.
    """
    count, edges = len(saddles.points), saddles.edges
    nearest = np.concatenate(
        [_ahead(saddles, slice(first, first + AT_ONCE)) for first in range(0, count, AT_ONCE)]
    )
    arriving = np.einsum("ikx,ikmx->ikm", edges, edges[nearest]).argmax(
        -1
    )  # the neighbour's edge that goes on in the same direction
    back = nearest[nearest, (arriving + 2) % 4]
    mutual = (nearest >= 0) & (back == np.arange(count)[:, None])
    return np.where(mutual, nearest, -1), (arriving - np.arange(4)) % 4


def _ahead(saddles: Saddles, some: slice) -> NDArray[np.intp]:
    """(m, 4) of m saddles, by edge: the nearest opposite one along it, -1 for none."""
    points = saddles.points
    x, y = points.T.astype(np.float32)
    squared = np.square(x[some, None] - x) + np.square(y[some, None] - y)
    other = np.argpartition(squared, min(NEARBY, len(points) - 1), axis=1)[
        :, : NEARBY + 1
    ]  # itself among them
    far = np.sqrt(np.take_along_axis(squared, other, 1))[..., None]
    way = points[other] - points[some, None]  # (i, j, 2)
    opposite = saddles.bends[other] @ saddles.bends[some, :, None] < OPPOSITE  # (i, j, 1)
    ahead = way @ saddles.edges[some].swapaxes(1, 2) > AHEAD * far  # (i, j, edge)
    distance = np.where(ahead & opposite, far, np.inf)
    nearest = np.take_along_axis(other, distance.argmin(1), 1)  # (i, edge)
    nearest[~np.isfinite(distance.min(1))] = -1
    return nearest


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


def _count(
    start: int, neighbour: list[list[int]], turned: list[list[int]]
) -> dict[int, tuple[int, int]]:
    """Row and column of every saddle that is reached from the first.

    A place belongs to the one that comes to it first.
    """
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
