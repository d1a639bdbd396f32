"""Group saddles into the checkerboard that they belong to, or the part of it in the picture.

Two saddles are neighbours if each is the nearest opposite one along an edge of the other. Counting
squares from neighbour to neighbour gives every saddle a column and a row. The count follows only
the sides of whole squares, because clutter seldom forms a square. It goes around a corner that
glare or a finger hides.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.saddles import Saddles, find_saddles
from calib.session.board import Board

# cosine between second derivatives: perspective and uneven light keep those of neighbours below
# -0.8
MAX_COSINE = -0.6
# cosine between an edge and the line to its other end: 16 degrees, for bent edges and the grain of
# pixels
MIN_ALIGNMENT = 0.96
# saddles among which a neighbour is looked for: twelve are equally near on a board that is tilted
# to a third of its height
CANDIDATES = 24
MIN_SADDLES = 9  # texture makes smaller groups by chance
CLUTTER = 300  # saddles besides the board's, stronger than the weakest of its corners
NEIGHBOUR_BATCH = 256  # saddles whose distances to all others are held in memory


@dataclass(frozen=True, slots=True, eq=False)
class SaddleGrid:
    """Saddles in columns and rows."""

    points: NDArray[np.float64]
    """(rows, columns, 2) px, NaN where there is no saddle."""
    runner_up: "SaddleGrid | None" = None
    """The second largest grid of the picture."""

    @property
    def present(self) -> NDArray[np.bool_]:
        """(rows, columns), true where there is a saddle."""
        return np.isfinite(self.points[..., 0])

    def board_positions(self, board: Board) -> Iterator[NDArray[np.float64]]:
        """Yield (count, 2) px, row by row, for each orientation in which the full board lies in the
        grid.

        A stray saddle at the board's rim is accepted. A line of them is not: it belongs to a larger
        board.
        """
        for points in (self.points, self.points.swapaxes(0, 1)):
            present = np.isfinite(points[..., 0])
            spare = present.sum() - board.count
            if (
                present.shape[0] < board.rows
                or present.shape[1] < board.columns
                or spare > 0.5 * min(board.rows, board.columns)
            ):
                continue
            windows = np.lib.stride_tricks.sliding_window_view(
                present, (board.rows, board.columns)
            ).all((-1, -2))
            row, column = np.unravel_index(windows.argmax(), windows.shape)
            if windows.any():
                yield points[row : row + board.rows, column : column + board.columns].reshape(-1, 2)


def find_grid(grey: NDArray[np.uint8], board: Board) -> SaddleGrid | None:
    """Return the largest grid of a (H, W) picture, unless it is more cluttered than a picture that
    shows this board.
    """
    return grid_of(find_saddles(grey, CLUTTER + board.count))


def grid_of(saddles: Saddles) -> SaddleGrid | None:
    """Return the largest grid with at least MIN_SADDLES saddles; its `runner_up` is the next
    largest.
    """
    if len(saddles.points) < MIN_SADDLES:
        return None
    neighbours, turns = _neighbours(saddles)
    neighbour_list = _keep_square_sides(neighbours, turns).tolist()
    turn_list = turns.tolist()
    best: list[dict[int, tuple[int, int]]] = [{}, {}]
    remaining = {saddle for saddle, edges in enumerate(neighbour_list) if max(edges) >= 0}
    while len(remaining) > max(len(best[1]), MIN_SADDLES - 1):
        group = _assign_cells(next(iter(remaining)), neighbour_list, turn_list)
        remaining -= group.keys()
        best = sorted([*best, group], key=len, reverse=True)[:2]
    first = _grid(saddles, best[0])
    second = _grid(saddles, best[1])
    return replace(first, runner_up=second) if first else None


def _grid(saddles: Saddles, group: dict[int, tuple[int, int]]) -> SaddleGrid | None:
    if len(group) < MIN_SADDLES:
        return None
    cells = np.array(list(group.values()))
    cells -= cells.min(0)
    points = np.full((*cells.max(0) + 1, 2), np.nan)
    points[cells[:, 0], cells[:, 1]] = saddles.points[list(group)]
    return SaddleGrid(points)


def _neighbours(saddles: Saddles) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return two (n, 4) arrays by saddle and edge: the neighbour, or -1, and by how many edges the
    neighbour's numbering is turned against the saddle's.
    """
    count, edges = len(saddles.points), saddles.edges
    nearest = np.concatenate(
        [
            _nearest_along_edges(saddles, slice(first, first + NEIGHBOUR_BATCH))
            for first in range(0, count, NEIGHBOUR_BATCH)
        ]
    )
    arriving = np.einsum("ikx,ikmx->ikm", edges, edges[nearest]).argmax(
        -1
    )  # the neighbour's edge that goes on in the same direction
    back = nearest[nearest, (arriving + 2) % 4]
    mutual = (nearest >= 0) & (back == np.arange(count)[:, None])
    return np.where(mutual, nearest, -1), (arriving - np.arange(4)) % 4


def _nearest_along_edges(saddles: Saddles, batch: slice) -> NDArray[np.intp]:
    """Return (m, 4), for m of the saddles and each of their edges the nearest opposite saddle along
    it, or -1.
    """
    points = saddles.points
    x, y = points.T.astype(np.float32)
    squared = np.square(x[batch, None] - x) + np.square(y[batch, None] - y)
    candidates = np.argpartition(squared, min(CANDIDATES, len(points) - 1), axis=1)[
        :, : CANDIDATES + 1
    ]  # itself among them
    distances = np.sqrt(np.take_along_axis(squared, candidates, 1))[..., None]
    offsets = points[candidates] - points[batch, None]  # (i, j, 2)
    opposite = (
        saddles.curvatures[candidates] @ saddles.curvatures[batch, :, None] < MAX_COSINE
    )  # (i, j, 1)
    aligned = (
        offsets @ saddles.edges[batch].swapaxes(1, 2) > MIN_ALIGNMENT * distances
    )  # (i, j, edge)
    allowed_distances = np.where(aligned & opposite, distances, np.inf)
    nearest = np.take_along_axis(candidates, allowed_distances.argmin(1), 1)  # (i, edge)
    nearest[~np.isfinite(allowed_distances.min(1))] = -1
    return nearest


def _keep_square_sides(neighbour: NDArray[np.intp], turned: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the neighbours, -1 for those that no side of a whole square joins."""
    start, first_edge = np.indices(neighbour.shape)
    closed = np.zeros(neighbour.shape, bool)
    for turn in (1, 3):
        saddle, edge = start, first_edge
        complete = np.ones(neighbour.shape, bool)
        for _ in range(4):
            following = neighbour[saddle, edge]
            complete &= following >= 0
            edge = (edge + turned[saddle, edge] + turn) % 4
            saddle = following
        closed |= complete & (saddle == start)
    return np.where(closed, neighbour, -1)


def _assign_cells(
    start: int, neighbour: list[list[int]], turned: list[list[int]]
) -> dict[int, tuple[int, int]]:
    """Return the row and column of every saddle that the count reaches from the first one.

    A cell belongs to the saddle that reaches it first.
    """
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    cells = {start: (0, 0)}
    taken = {(0, 0)}
    turns = {start: 0}
    queue = deque([start])
    while queue:
        saddle = queue.popleft()
        row, column = cells[saddle]
        for edge in range(4):
            following = neighbour[saddle][edge]
            row_step, column_step = steps[(edge - turns[saddle]) % 4]
            cell = row + row_step, column + column_step
            if following >= 0 and following not in cells and cell not in taken:
                cells[following] = cell
                turns[following] = (turns[saddle] + turned[saddle][edge]) % 4
                taken.add(cell)
                queue.append(following)
    return cells
