"""By how much black looks larger than it is, as a picture's tags tell it themselves.

A camera brightens what is dark, which moves the half-way level of a blurred step into the black, by
some tenths of a pixel: all tags look smaller, and so farther away. Ink that spreads does the
opposite. Neither shows in a tag's outline alone. But within it, cells of black and of white border
on each other both ways round, and where black grows, white cells shrink: edges that look one way
move against those that look the other. The growth is what makes both agree, the same for all tags
of a picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.patch_fit import SIGMA
from calib.corners.tag_outline import BLUR, PLACE, Floats, Outlines, edges_of, fit_edge

MOST = 160
"""Edges of cells that are measured in a picture: half a millisecond each."""
FEWEST = 16
"""That say something."""
OUTLYING = 3.0
"""Standard deviations."""
SEEN = 4.0
"""Standard deviations: a growth that is smaller is none."""


@dataclass(frozen=True, slots=True)
class Growth:
    """Outwards at every edge of black, px."""

    px: float
    sigma: float

    @property
    def seen(self) -> bool:
        return abs(self.px) > SEEN * self.sigma


NONE = Growth(0.0, 0.0)


def growth_of(grey: NDArray, corners: Floats, black: Sequence[NDArray[np.bool_]]) -> Growth:
    """Of the tags of a (H, W) uint8 or uint16 picture.

    Args:
        corners: (T, 4, 2) px, measured, clockwise from the upper left of the upright tag.
        black: T upright tags of (n, n) cells, with their black border.
    """
    every = [(at, *edge) for at, cells in enumerate(black) for edge in _edges(cells)]
    rows = []
    for at, start, end, axis, outward in every[:: -(-len(every) // MOST) or 1]:
        cells = len(black[at])
        square = np.array([[0, 0], [cells, 0], [cells, cells], [0, cells]], np.float32)
        to_pixels = cv2.getPerspectiveTransform(square, corners[at].astype(np.float32))
        first, last = cv2.perspectiveTransform(np.array([[start, end]], np.float64), to_pixels)[0]
        step = last - first
        normal = np.array([step[1], -step[0]]) / np.hypot(
            *step
        )  # to the left of who goes from the first to the last
        found = fit_edge(
            grey,
            first,
            step,
            normal,
            0.0,
            BLUR,
            float(np.hypot(*step)) / max(1, np.abs(end - start).max()),
        )
        if found is not None and found.inverse[PLACE, PLACE] > 0:
            # The outline has grown too, and with it, in proportion, where this edge is expected.
            expected = outward * (2 * start[axis] / cells - 1)
            rows.append((found.parameters[PLACE], 1 - expected, found.inverse[PLACE, PLACE]))
    if len(rows) < FEWEST:
        return NONE
    place, lever, variance = np.array(rows).T
    return _least(place, lever, variance)


def without(growth: Growth, outlines: Outlines) -> Outlines:
    """The corners where they would be if black had not grown."""
    _, normals = edges_of(outlines.corners)
    both = np.stack(
        [np.roll(normals, 1, 1), normals], -2
    )  # (T, 4, 2, 2), of the edge before a corner, and of that behind
    outwards = np.linalg.solve(both, np.ones((*both.shape[:2], 2, 1)))[
        ..., 0
    ]  # px for each of growth
    flat = outwards.reshape(len(outwards), -1)
    spread = growth.sigma**2 * flat[:, :, None] * flat[:, None, :]
    return Outlines(outlines.corners - growth.px * outwards, outlines.covariances + spread)


def _least(place: Floats, lever: Floats, variance: Floats) -> Growth:
    """Of (N,) px = growth times (N,), the outlying left out; its sigma from how the rest
    scatter.
    """
    kept = np.ones(len(place), bool)
    px = spread = 0.0
    for _ in range(5):
        weight = kept / variance
        px = float((weight * lever * place).sum() / (weight * lever**2).sum())
        left = (place - px * lever) / np.sqrt(variance)
        spread = SIGMA * float(np.median(np.abs(left)))
        kept = np.abs(left) <= OUTLYING * spread
    return Growth(px, spread / float(np.sqrt((kept * lever**2 / variance).sum())))


def _edges(black: NDArray[np.bool_]) -> list[tuple[Floats, Floats, int, int]]:
    """The edges between cells within a tag: where each begins and ends, in cells, with white at the
    left, as seen in the picture; the axis across it; and 1 where white is on the side of larger
    coordinates, or -1.
    """
    found = []
    for axis in (0, 1):
        cells = black if axis == 1 else black.T  # across the first index
        for row, column in zip(*np.nonzero(cells[1:] != cells[:-1]), strict=True):
            outward = 1 if cells[row, column] else -1  # black before, white behind
            ends = np.array([[column, row + 1.0], [column + 1.0, row + 1.0]])
            ends = ends if axis == 1 else ends[:, ::-1]
            # Going along +x with y down, the left is -y; along +y it is +x.
            turned = outward > 0 if axis == 1 else outward < 0
            first, last = ends[::-1] if turned else ends
            found.append((first, last, axis, outward))
    return found
