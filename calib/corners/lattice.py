"""A grid of corners as its neighbours see it: where each corner's two edges lead, and how they
bend.

A whole checkerboard's corners are all there, at equal distances. Of one that is partly hidden, and
of a board with markers, some may be missing; and of the latter, a corner's edges end, or something
else begins beside them, before the next corner.

An edge that bends by one pixel over a square looks, to a straight line through the half of it that
is measured, like a corner moved by
some hundredths of a pixel: so the bend is taken from the neighbours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.local_map import LocalMap
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco

Floats = NDArray[np.float64]

BORDER = 0.2  # of a tag's side: its black border
FREE = 0.83  # of the small square's side
FARTHEST = 0.4  # of a tag's side
CLEAR = 0.8  # of what lies between a tag's edge and its bits
# of what lies between a square's edge and its marker: from there on, blur brings the marker's black
CLEAR_OF_MARKER = 0.6
NOISE = 0.1  # px, of corners that were found
SECOND, THIRD = 6, 20  # variances of an error's second and third differences, over its own


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """N corners of one picture and the two edges through each, the row's first."""

    corners: Floats
    """(N, 2) px."""
    steps: Floats
    """(N, 2 edges, 2) px, along each edge to the next corner, in the mean of both sides; of an
    AprilGrid, twice what is free of others.
    """
    curvatures: Floats
    """(N, 2 edges) 1/px, of each edge, towards its normal."""
    clear: float = np.inf
    """Steps: beside an edge, only so much shows nothing but that edge."""

    @staticmethod
    def of(corners: Floats, board: Board) -> "Lattice":
        """From (count, 2) px, row by row, columns fastest: those that are not NaN."""
        if board.coding is None and np.isfinite(corners).all():
            return Lattice._whole(corners, board)
        return Lattice._some(corners, board, *_step_and_clear(board))

    @staticmethod
    def between(corners: Floats, ahead: Floats, behind: Floats, board: Board) -> "Lattice":
        """From (N, 2) px, and (N, 2 edges, 2) px, where a model sees what is half a `step_of` the
        board further along each edge, and before.
        """
        steps, bends = ahead - behind, 4 * (ahead + behind - 2 * corners[:, None])
        _, clear = _step_and_clear(board)
        return Lattice(corners, steps, (normals(steps) * bends).sum(-1) / (steps**2).sum(-1), clear)

    @staticmethod
    def _some(corners: Floats, board: Board, step: float, clear: float) -> "Lattice":
        """`step` in m."""
        seen = np.isfinite(corners[:, 0])
        unit = 2 * board.half[0] / (board.columns - 1)
        points = board.points()[seen] / unit
        near = LocalMap.of(points, corners[seen], points, NOISE, changing=True)
        bends = (normals(near.steps) * near.bends).sum(-1)
        return Lattice(
            corners[seen], near.steps * (step / unit), bends / (near.steps**2).sum(-1), clear
        )

    @staticmethod
    def _whole(corners: Floats, board: Board) -> "Lattice":
        grid = corners.reshape(board.rows, board.columns, 2)
        steps, curvatures = np.empty((*grid.shape[:2], 2, 2)), np.empty(grid.shape)
        for edge, turned in enumerate((grid, grid.swapaxes(0, 1))):
            own = (
                part[:, :, edge] if edge == 0 else part[:, :, edge].swapaxes(0, 1)
                for part in (steps, curvatures)
            )
            for part, values in zip(own, _along(turned), strict=True):
                part[...] = values
        return Lattice(
            np.array(corners, np.float64), steps.reshape(-1, 2, 2), curvatures.reshape(-1, 2)
        )

    @property
    def angles(self) -> Floats:
        """(N, 2 edges) rad, of the edges' directions."""
        return np.asarray(np.arctan2(self.steps[..., 1], self.steps[..., 0]))

    @property
    def heights(self) -> Floats:
        """(N, 2 edges) px, from each edge to the parallel one through the next corner."""
        (ax, ay), (bx, by) = np.moveaxis(self.steps, 0, -1)
        return np.asarray(np.abs(ax * by - ay * bx)[:, None] / np.linalg.norm(self.steps, axis=-1))


def step_of(board: Board) -> float:
    """m, of a lattice's steps."""
    return _step_and_clear(board)[0]


def _step_and_clear(board: Board) -> tuple[float, float]:
    """m, and steps."""
    match board.coding:
        case None:
            return board.square, np.inf
        case Charuco(marker):
            return board.square, CLEAR_OF_MARKER * (1 - marker / board.square) / 2
        case AprilGrid(spacing):
            reach = min(FREE * spacing, FARTHEST)
            return 2 * reach * board.square, CLEAR * BORDER / (2 * reach)


def normals(steps: Floats) -> Floats:
    """(..., 2) unit, 90 degrees clockwise, as seen in the picture, of (..., 2)."""
    turned = np.stack([-steps[..., 1], steps[..., 0]], -1)
    return np.asarray(turned / np.linalg.norm(steps, axis=-1, keepdims=True))


def _along(lines: Floats) -> tuple[Floats, Floats]:
    """(lines, corners, 2) px -> of the same shape, the step at each corner; and (lines, corners)
    1/px, how the line bends there: what the second difference tells, of which the ends take their
    neighbours'.
    """
    apart = lines[:, 1:] - lines[:, :-1]
    bends = np.empty_like(lines)
    bends[:, 1:-1] = apart[:, 1:] - apart[:, :-1]
    bends[:, 0], bends[:, -1] = bends[:, 1], bends[:, -2]
    steps = np.empty_like(lines)
    steps[:, 1:-1] = (apart[:, 1:] + apart[:, :-1]) / 2
    steps[:, 0], steps[:, -1] = apart[:, 0] - bends[:, 0] / 2, apart[:, -1] + bends[:, -1] / 2
    squared = steps[..., 0] ** 2 + steps[..., 1] ** 2
    length = np.sqrt(squared)
    across = (bends[..., 1] * steps[..., 0] - bends[..., 0] * steps[..., 1]) / length
    change = bends[:, 2:-1] - bends[:, 1:-2]
    third = (change[..., 1] * steps[:, 1:-2, 0] - change[..., 0] * steps[:, 1:-2, 1]) / length[
        :, 1:-2
    ]
    return steps, _told(across, float((third**2).mean()) if third.size else 0.0) / squared


def _told(bends: Floats, third: float) -> Floats:
    """What (lines, corners) px of bends tell beside what the corners' own errors make of them,
    smoothed: James and Stein's part of it, the errors' size by px^2 of third differences, which
    bends hardly have.
    """
    inner = float((bends[:, 1:-1] ** 2).mean())
    noise = third * SECOND / THIRD
    return _smoothed(bends) * (max(0.0, 1 - noise / inner) if inner else 0.0)


def _smoothed(bends: Floats) -> Floats:
    """(lines, corners) means of each and its neighbours by the weights 1, 2, 1, both ways: a
    corner's own error would else come back to it, larger by a sixth, in its bend.
    """
    for _ in range(2):
        smooth = np.empty_like(bends)
        smooth[1:-1] = bends[:-2] + 2 * bends[1:-1] + bends[2:]
        smooth[0], smooth[-1] = 3 * bends[0] + bends[1], 3 * bends[-1] + bends[-2]
        bends = smooth.T / 4
    return bends
