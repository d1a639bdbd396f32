"""Measure by how much black looks larger than it is, from the tags of a picture themselves.

A camera brightens what is dark. That moves the half-way level of a blurred step into the black by
some tenths of a pixel: all tags look smaller, and so farther away. Ink that spreads does the
opposite. A tag's outline alone shows neither. But within the tag, black and white cells adjoin in
both orders, and where black grows, white cells shrink: edges that face one way move against those
that face the other. The spread is the number of pixels that makes both agree, common to all tags of
a picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.patch_fit import MAD_TO_SIGMA
from calib.corners.tag_outline import BLUR, PLACE, Floats, Outlines, edge_vectors, fit_edge

MAX_EDGES = 160
"""Edges of cells that are measured in a picture: each takes half a millisecond."""
MIN_EDGES = 16
"""Edges that an estimate of the spread needs."""
OUTLIER_THRESHOLD = 3.0
"""Standard deviations."""
SIGNIFICANCE = 4.0
"""Standard deviations: a smaller spread is taken as none."""


@dataclass(frozen=True, slots=True)
class InkSpread:
    """The shift of every edge of black, outwards, px."""

    px: float
    sigma: float

    @property
    def is_significant(self) -> bool:
        """True if the spread is not explained by noise."""
        return abs(self.px) > SIGNIFICANCE * self.sigma


NO_INK_SPREAD = InkSpread(0.0, 0.0)


def measure_ink_spread(
    grey: NDArray, corners: Floats, black: Sequence[NDArray[np.bool_]]
) -> InkSpread:
    """Measure the spread from the tags of a (H, W) uint8 or uint16 picture.

    Args:
        grey: (H, W).
        corners: (T, 4, 2) px, measured, clockwise from the upper left of the upright tag.
        black: T upright tags of (n, n) cells, with their black border.
    """
    cell_edges = [(tag, edge) for tag, cells in enumerate(black) for edge in _cell_edges(cells)]
    shifts = []
    levers = []
    variances = []
    for tag, cell_edge in cell_edges[:: -(-len(cell_edges) // MAX_EDGES) or 1]:
        cells = len(black[tag])
        square = np.array([[0, 0], [cells, 0], [cells, cells], [0, cells]], np.float32)
        to_pixels = cv2.getPerspectiveTransform(square, corners[tag].astype(np.float32))
        ends = np.array([[cell_edge.start, cell_edge.end]], np.float64)
        first, last = cv2.perspectiveTransform(ends, to_pixels)[0]
        step = last - first
        length = float(np.hypot(*step))
        # to the left, seen from the first end towards the last
        normal = np.array([step[1], -step[0]]) / np.hypot(*step)
        cell_count = max(1, np.abs(cell_edge.end - cell_edge.start).max())
        edge = fit_edge(grey, first, step, normal, 0.0, BLUR, length / cell_count)
        if edge is not None and edge.inverse[PLACE, PLACE] > 0:
            # The outline has grown too, and the expected place of this edge moves in proportion.
            outline_share = cell_edge.outward * (2 * cell_edge.start[cell_edge.axis] / cells - 1)
            shifts.append(edge.parameters[PLACE])
            levers.append(1 - outline_share)
            variances.append(edge.inverse[PLACE, PLACE])
    if len(shifts) < MIN_EDGES:
        return NO_INK_SPREAD
    return _fit_spread(np.array(shifts), np.array(levers), np.array(variances))


def remove_ink_spread(spread: InkSpread, outlines: Outlines) -> Outlines:
    """Return the corners where they would be without the spread."""
    _, normals = edge_vectors(outlines.corners)
    # (T, 4, 2, 2), those of the edge that ends at a corner, and of the edge that starts there
    both_normals = np.stack([np.roll(normals, 1, 1), normals], -2)
    # (T, 4, 2) px per px of spread
    outwards = np.linalg.solve(both_normals, np.ones((*both_normals.shape[:2], 2, 1)))[..., 0]
    flat = outwards.reshape(len(outwards), -1)
    covariance = spread.sigma**2 * flat[:, :, None] * flat[:, None, :]
    corners = outlines.corners - spread.px * outwards
    return Outlines(corners, outlines.covariances + covariance, outlines.blurs)


def _fit_spread(shifts: Floats, levers: Floats, variances: Floats) -> InkSpread:
    """Fit (N,) px shifts = spread times (N,) levers without outliers.

    The sigma comes from the scatter of the residuals.
    """
    inliers = np.ones(len(shifts), bool)
    px = scatter = 0.0
    for _ in range(5):
        weight = inliers / variances
        px = float((weight * levers * shifts).sum() / (weight * levers**2).sum())
        residuals = (shifts - px * levers) / np.sqrt(variances)
        scatter = MAD_TO_SIGMA * float(np.median(np.abs(residuals)))
        inliers = np.abs(residuals) <= OUTLIER_THRESHOLD * scatter
    return InkSpread(px, scatter / float(np.sqrt((inliers * levers**2 / variances).sum())))


@dataclass(frozen=True, slots=True, eq=False)
class _CellEdge:
    """An edge between a black and a white cell within a tag."""

    start: Floats
    """(2,) cells. White is to the left of the way to the end, as seen in the picture."""
    end: Floats
    """(2,) cells."""
    axis: int
    """0 or 1, the axis that crosses the edge."""
    outward: int
    """+1 if white is on the side of larger coordinates, else -1."""


def _cell_edges(black: NDArray[np.bool_]) -> list[_CellEdge]:
    """Return the edges between the cells of a tag."""
    edges = []
    for axis in (0, 1):
        cells = black if axis == 1 else black.T  # the axis crosses the first index
        for row, column in zip(*np.nonzero(cells[1:] != cells[:-1]), strict=True):
            outward = 1 if cells[row, column] else -1  # black first, then white
            ends = np.array([[column, row + 1.0], [column + 1.0, row + 1.0]])
            ends = ends if axis == 1 else ends[:, ::-1]
            # Going along +x with y down, the left is -y; along +y it is +x.
            reverse = outward > 0 if axis == 1 else outward < 0
            first, last = ends[::-1] if reverse else ends
            edges.append(_CellEdge(first, last, axis, outward))
    return edges
