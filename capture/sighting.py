"""What a live finder says of one frame, whatever the board."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.exposure import Exposure
from capture.frames import Frame
from capture.sharpness import Blur


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What was seen of the board in one frame."""

    corners: NDArray[np.float64] | None
    """(count, 2) px of the full frame, of a checkerboard in the order of `canonical_order`, to some
    tenths of a pixel; NaN where a board with markers hides one. None: no board, or not enough of
    it, was found.
    """
    width: int
    height: int
    time_s: float
    part: NDArray[np.float64] | None = None
    """(n, 2) px, the corners seen of something that is a board, but not enough of this one."""
    too_large: bool = False
    """Whether that has more columns or rows than the board."""
    problem: str = ""
    """Why there are no corners, in words of the finder's own."""
    square: float = np.nan
    """px, mean distance between neighbouring corners."""
    window: float = np.nan
    """px, how far from the picture's border the outermost corner must be."""
    blur: Blur | None = None
    exposure: Exposure | None = None


class LiveFinder(Protocol):
    """Finds one board in frame after frame."""

    def look(self, frame: Frame) -> Sighting: ...

    def refine(self, frame: Frame, sighting: Sighting) -> NDArray[np.float64] | None:
        """(count, 2) px, to some hundredths, as `calib.corners` starts from, NaN where not seen.

        None: the corners cannot be measured.
        """
        ...


def grey_of(frame: Frame) -> NDArray[np.uint8]:
    """(H, W)"""
    pixels = frame.pixels
    return (
        pixels
        if pixels.ndim == 2
        else np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
    )


def side(grid: NDArray) -> float:
    """px, mean distance between neighbours in (rows, columns, 2), some of which may be NaN; NaN
    where there are none.
    """
    steps = np.concatenate(
        [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    )
    steps = steps[np.isfinite(steps)]
    return float(steps.mean()) if steps.size else np.nan
