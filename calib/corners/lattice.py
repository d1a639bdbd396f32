"""The local geometry of a grid of corners: the directions of the two edges through each corner, and
the curvature of these edges.

A whole checkerboard has all its corners, at equal distances. Corners may be missing where a board
is partly hidden or has markers. On a board with markers, a corner's edges also end, or another edge
starts beside them, before the next corner.

An edge that bends by one pixel over a square shifts a straight line through its measured half by
some hundredths of a pixel. That looks like a corner that has moved, so the curvature is taken from
the neighbours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.corners.markers import border_of, marker_cells
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

SMALL_SQUARE_FRACTION = 0.83  # of the small square's side, that an edge is measured on
MAX_TAG_REACH = 0.4  # of a tag's side, that an edge is measured on
TAG_CLEARANCE = 0.8  # of the distance between a tag's edge and its bits
# of the distance between a square's edge and its marker: beyond, blur brings in the marker's black
MARKER_CLEARANCE = 0.6
LOCATION_NOISE = 0.1  # px, of located corners
# the variances of the second and third differences of independent errors, over the errors' own
SECOND_DIFFERENCE = 6
THIRD_DIFFERENCE = 20


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """The N visible corners of one picture, and the two edges through each: the row's edge, then
    the column's.
    """

    corners: Floats
    """(N, 2) px."""
    steps: Floats
    """(N, 2 edges, 2) px along each edge to the next corner, the mean of both directions. For an
    AprilGrid, a step is twice the length on which the edge is undisturbed.
    """
    curvatures: Floats
    """(N, 2 edges) 1/px, the curvature of each edge, positive towards its normal."""
    clearance: float = np.inf
    """Steps: the distance from an edge within which the picture shows that edge alone."""

    @staticmethod
    def from_corners(corners: Floats, board: Board) -> "Lattice":
        """Return the lattice of (count, 2) px corners, row by row, columns fastest. Corners that
        are NaN are skipped.
        """
        if board.coding is None and np.isfinite(corners).all():
            return Lattice._of_full_grid(corners, board)
        return Lattice._of_visible_corners(corners, board, *_step_and_clearance(board))

    @staticmethod
    def from_model(corners: Floats, ahead: Floats, behind: Floats, board: Board) -> "Lattice":
        """Return the lattice at the places that a camera model predicts.

        Args:
            corners: (N, 2) px.
            ahead: (N, 2 edges, 2) px, the places half a `lattice_step` further along each edge.
            behind: (N, 2 edges, 2) px, the places half a step back.
            board: the board.
        """
        steps = ahead - behind
        bends = 4 * (ahead + behind - 2 * corners[:, None])
        _, clearance = _step_and_clearance(board)
        curvatures = (edge_normals(steps) * bends).sum(-1) / (steps**2).sum(-1)
        return Lattice(corners, steps, curvatures, clearance)

    @staticmethod
    def _of_visible_corners(
        corners: Floats, board: Board, step: float, clearance: float
    ) -> "Lattice":
        """Fit a local map at every visible corner; `step` is the lattice's step in m."""
        visible = np.isfinite(corners[:, 0])
        unit = 2 * board.half[0] / (board.columns - 1)
        points = board.points()[visible] / unit
        local_map = LocalMap.fit(points, corners[visible], points, LOCATION_NOISE, cubic=True)
        bends = (edge_normals(local_map.steps) * local_map.second_derivatives).sum(-1)
        return Lattice(
            corners[visible],
            local_map.steps * (step / unit),
            bends / (local_map.steps**2).sum(-1),
            clearance,
        )

    @staticmethod
    def _of_full_grid(corners: Floats, board: Board) -> "Lattice":
        """Take the steps and curvatures from differences along the rows and columns."""
        grid = corners.reshape(board.rows, board.columns, 2)
        row_steps, row_curvatures = _differentiate_lines(grid)
        column_steps, column_curvatures = _differentiate_lines(grid.swapaxes(0, 1))
        steps = np.stack([row_steps, column_steps.swapaxes(0, 1)], 2)
        curvatures = np.stack([row_curvatures, column_curvatures.swapaxes(0, 1)], 2)
        return Lattice(
            np.array(corners, np.float64), steps.reshape(-1, 2, 2), curvatures.reshape(-1, 2)
        )

    @property
    def angles(self) -> Floats:
        """(N, 2 edges) rad, the directions of the edges."""
        return np.asarray(np.arctan2(self.steps[..., 1], self.steps[..., 0]))

    @property
    def heights(self) -> Floats:
        """(N, 2 edges) px, the distance from each edge to the parallel one through the next
        corner.
        """
        (ax, ay), (bx, by) = np.moveaxis(self.steps, 0, -1)
        return np.asarray(np.abs(ax * by - ay * bx)[:, None] / np.linalg.norm(self.steps, axis=-1))


def lattice_step(board: Board) -> float:
    """Return the length of a lattice's step on the board, m."""
    return _step_and_clearance(board)[0]


def _step_and_clearance(board: Board) -> tuple[float, float]:
    """Return the step in m and the clearance in steps."""
    match board.coding:
        case None:
            return board.square, np.inf
        case Charuco(marker):
            return board.square, MARKER_CLEARANCE * (1 - marker / board.square) / 2
        case AprilGrid(spacing) as coding:
            reach = min(SMALL_SQUARE_FRACTION * spacing, MAX_TAG_REACH)
            tag_border = border_of(coding) / marker_cells(coding)  # of a tag's side
            return 2 * reach * board.square, TAG_CLEARANCE * tag_border / (2 * reach)


def edge_normals(steps: Floats) -> Floats:
    """Return (..., 2) unit normals, 90 degrees clockwise of the steps as seen in the picture."""
    perpendicular = np.stack([-steps[..., 1], steps[..., 0]], -1)
    return np.asarray(perpendicular / np.linalg.norm(steps, axis=-1, keepdims=True))


def _differentiate_lines(lines: Floats) -> tuple[Floats, Floats]:
    """Return the (lines, corners, 2) px step at each corner of (lines, corners, 2) px lines, and
    the (lines, corners) 1/px curvature there.

    The curvature comes from second differences. A line's end has the second difference of its
    neighbour.
    """
    differences = lines[:, 1:] - lines[:, :-1]
    bends = np.empty_like(lines)
    bends[:, 1:-1] = differences[:, 1:] - differences[:, :-1]
    bends[:, 0] = bends[:, 1]
    bends[:, -1] = bends[:, -2]
    steps = np.empty_like(lines)
    steps[:, 1:-1] = (differences[:, 1:] + differences[:, :-1]) / 2
    steps[:, 0] = differences[:, 0] - bends[:, 0] / 2
    steps[:, -1] = differences[:, -1] + bends[:, -1] / 2
    squared = steps[..., 0] ** 2 + steps[..., 1] ** 2
    length = np.sqrt(squared)
    normal_bends = (bends[..., 1] * steps[..., 0] - bends[..., 0] * steps[..., 1]) / length
    change = bends[:, 2:-1] - bends[:, 1:-2]
    third = (change[..., 1] * steps[:, 1:-2, 0] - change[..., 0] * steps[:, 1:-2, 1]) / length[
        :, 1:-2
    ]
    third_squared = float((third**2).mean()) if third.size else 0.0
    return steps, _shrink_bends(normal_bends, third_squared) / squared


def _shrink_bends(bends: Floats, third_squared: float) -> Floats:
    """Return the (lines, corners) px bends, smoothed, and shrunk by the James-Stein factor for the
    corners' own errors.

    The third differences tell the size of these errors: a real bend hardly changes from corner to
    corner.

    Args:
        bends: (lines, corners) px, second differences towards the normal.
        third_squared: px^2, mean square of the third differences.
    """
    mean_square = float((bends[:, 1:-1] ** 2).mean())
    noise = third_squared * SECOND_DIFFERENCE / THIRD_DIFFERENCE
    return _smooth_bends(bends) * (max(0.0, 1 - noise / mean_square) if mean_square else 0.0)


def _smooth_bends(bends: Floats) -> Floats:
    """Return the (lines, corners) means of each bend and its neighbours, with the weights 1, 2, 1
    in both directions.

    Without it, a corner's own error would come back to it through its bend, larger by a sixth.
    """
    for _ in range(2):
        smooth = np.empty_like(bends)
        smooth[1:-1] = bends[:-2] + 2 * bends[1:-1] + bends[2:]
        smooth[0], smooth[-1] = 3 * bends[0] + bends[1], 3 * bends[-1] + bends[-2]
        bends = smooth.T / 4
    return bends
