"""The board that a live finder detects in one frame, for every type of board."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.exposure import SquareLighting
from capture.frames import Frame
from capture.sharpness import Blur


@dataclass(frozen=True, slots=True, eq=False)
class LiveDetection:
    """The board as one frame shows it."""

    corners: NDArray[np.float64] | None
    """(count, 2) px in the full frame, accurate to some tenths of a pixel. A checkerboard's corners
    are in `canonical_order`. A board with markers has NaN where a corner is hidden. None: the frame
    shows no board, or not enough of it.
    """
    width: int
    height: int
    time_s: float
    partial_corners: NDArray[np.float64] | None = None
    """(n, 2) px, the visible corners of an object that looks like a board but is not enough of this
    one.
    """
    too_large: bool = False
    """True if that object has more columns or rows than the board."""
    problem: str = ""
    """The finder's own reason why there are no corners; empty if it has none."""
    square: float = np.nan
    """px, the mean distance between neighbouring corners."""
    margin: float = np.nan
    """px, the minimum distance between the outermost corner and the picture's border."""
    blur: Blur | None = None
    exposure: SquareLighting | None = None


class LiveFinder(Protocol):
    """Detects one board in frame after frame."""

    def look(self, frame: Frame) -> LiveDetection: ...

    def refine(self, frame: Frame, detection: LiveDetection) -> NDArray[np.float64] | None:
        """Return (count, 2) px, accurate to some hundredths, as `calib.corners` starts from; NaN
        where not visible.

        None: the corners cannot be measured.
        """
        ...


def grey_of(frame: Frame) -> NDArray[np.uint8]:
    """Return the (H, W) grey picture."""
    pixels = frame.pixels
    return (
        pixels
        if pixels.ndim == 2
        else np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
    )


def mean_spacing(grid: NDArray) -> float:
    """Return the mean distance in px between neighbours in a (rows, columns, 2) grid. NaN entries
    are ignored; NaN where no pair is visible.
    """
    steps = np.concatenate(
        [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    )
    steps = steps[np.isfinite(steps)]
    return float(steps.mean()) if steps.size else np.nan
