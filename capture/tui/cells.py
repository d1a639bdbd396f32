"""A grey picture in the cells of a terminal, with marks on it. Pure.

Half blocks show two pixels per cell in greys. Dots show eight pixels per cell, black or white, for
a terminal without colours. Marks are characters, so they need no colour in either.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

LEVELS = 24  # grey levels: as many as a terminal of 256 colours has
CORNER_MARK, HINT_MARK, WORST_MARK, LINE_MARK = "+", "▒", "◆", "·"
DOTS = np.array(
    [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]]
)  # the bits of a braille character, rows by columns
GAMMA = 1.5  # dots look brighter than the grey that they represent
DITHER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16 + 1 / 32


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """The content of each cell of a picture."""

    upper: NDArray[np.uint8]
    """(rows, columns) grey, 0 to 255, of a cell's upper half."""
    lower: NDArray[np.uint8]
    characters: NDArray[np.str_]
    """(rows, columns) a mark or a pattern of dots; empty where the two halves are shown."""


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """One kind of mark: its character and its points."""

    character: str
    points: NDArray[np.float64]
    """(n, 2) px of the frame."""
    closed: bool = False
    """True if the points are the corners of a polygon whose sides are marked."""
    label: str = ""
    """The text in the middle of a polygon, as far as it fits."""


def fit_cells(size: tuple[int, int], columns: int, rows: int) -> tuple[int, int]:
    """Return the columns and rows that a frame of this width and height fills in its shape: a cell
    is twice as high as wide.
    """
    scale = min(columns / size[0], 2 * rows / size[1])
    return max(round(size[0] * scale), 1), max(round(size[1] * scale / 2), 1)


def draw(
    grey: NDArray[np.uint8],
    size: tuple[int, int],
    columns: int,
    rows: int,
    marks: Sequence[Mark],
    *,
    dots: bool,
) -> Cells:
    """Draw a (h, w) picture of a frame of `size` px in columns x rows cells."""
    characters = np.full((rows, columns), "", "<U1")
    if dots:
        small = cv2.resize(grey, (2 * columns, 4 * rows), interpolation=cv2.INTER_AREA).astype(
            np.float64
        )
        low, high = np.percentile(small, (2, 98))
        bright = np.clip((small - low) / max(high - low, 1.0), 0, 1) ** GAMMA
        lit = bright > np.tile(DITHER, (rows, columns))[: 4 * rows, : 2 * columns]
        patterns = (lit.reshape(rows, 4, columns, 2) * DOTS[:, None]).sum((1, 3))
        characters = np.vectorize(chr, otypes=["<U1"])(0x2800 + patterns)
    halves = cv2.resize(grey, (columns, 2 * rows), interpolation=cv2.INTER_AREA)
    scale = np.array([columns, rows]) / size
    for mark in marks:
        _place(characters, mark, scale)
    for mark in marks:
        _place_label(characters, mark, scale)  # over all marks: it says what to do
    step = 255 / (LEVELS - 1)
    quantised = np.asarray(np.round(np.round(halves / step) * step), np.uint8)
    return Cells(quantised[::2], quantised[1::2], characters)


def _place(characters: NDArray[np.str_], mark: Mark, scale: NDArray[np.float64]) -> None:
    x, y = _visible_cells(characters, mark, scale)
    characters[y, x] = mark.character


def _place_label(characters: NDArray[np.str_], mark: Mark, scale: NDArray[np.float64]) -> None:
    x, y = _visible_cells(characters, mark, scale)
    if not mark.label or not len(x):
        return
    columns = characters.shape[1]
    middle, line = int(x.mean()), int(y.mean())
    start = min(max(middle - len(mark.label) // 2, 0), max(columns - len(mark.label), 0))
    for offset, letter in enumerate(mark.label[: columns - start]):
        characters[line, start + offset] = letter


def _visible_cells(
    characters: NDArray[np.str_], mark: Mark, scale: NDArray[np.float64]
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the column and row of each cell that the mark's points or sides lie in."""
    rows, columns = characters.shape
    cells = (np.asarray(mark.points) + 0.5) * scale  # (n, 2)
    if mark.closed:
        steps = np.linspace(0, 1, 2 * max(rows, columns))[:, None, None]
        cells = (cells + steps * (np.roll(cells, -1, 0) - cells)).reshape(-1, 2)
    x, y = np.floor(cells[np.isfinite(cells).all(1)]).astype(int).T
    visible = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    return x[visible], y[visible]
