"""The fringes that a camera sees best, from one picture of each of some periods."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.fringes.pattern import MIN_PERIOD, WHITE, ScreenPattern

RATIO = 1.45
"""From one period to the next: the optimum is flat."""
COARSEST = 5
"""Fringes over the shorter side of the screen, from which the search goes to finer ones. The
reference has as many waves, which a far camera still sees.
"""
FINEST = 8.0
"""Screen pixels of the finest fringe."""
MIN_MODULATION = 0.35
"""Of half of the contrast: at the best period it is 0.61, and places of the screen differ."""
MIN_CAMERA_PERIOD = 7.0
"""Camera pixels in a fringe in the middle of the picture, so that the far side of a tilted screen
still has the 4 that decoding asks for.
"""


@dataclass(frozen=True, slots=True)
class FringeTrial:
    """A period in one picture."""

    period: float
    """Screen pixels."""
    modulation: float
    """The amplitude over half of the contrast."""
    camera_period: float
    """Camera pixels."""

    @property
    def is_usable(self) -> bool:
        """True if these fringes can be decoded."""
        return self.modulation >= MIN_MODULATION and self.camera_period >= MIN_CAMERA_PERIOD


def trial_periods(width: int, height: int) -> Iterator[float]:
    """Yield periods from the coarsest on, for a screen of this size in px."""
    period = min(width, height) / COARSEST
    while period >= max(FINEST, MIN_PERIOD):
        yield period
        period /= RATIO


def trial_pattern(period: float, width: int, height: int) -> ScreenPattern:
    """Return fringes along x."""
    wave = np.cos(2 * np.pi * np.arange(width) / period)
    return ScreenPattern(
        np.rint(WHITE * (1 + wave) / 2).astype(np.uint8), np.full(height, WHITE, np.uint8)
    )


def reference_pattern(width: int, height: int) -> ScreenPattern:
    """Return waves along x and y, which show every motion."""
    lines = []
    for size in (width, height):
        wave = np.cos(2 * np.pi * np.arange(size) * COARSEST / min(width, height))
        lines.append(np.rint(WHITE * (2 + wave) / 3).astype(np.uint8))
    return ScreenPattern(lines[0], lines[1])


def judge_trial(
    period: float,
    black: NDArray[np.uint8],
    white: NDArray[np.uint8],
    fringes: NDArray[np.uint8],
    lit: NDArray[np.bool_],
) -> FringeTrial:
    """Return the fringes' amplitude and period in a picture; all pictures are (H, W) grey."""
    contrast = cv2.blur(white.astype(np.float64) - black, (3, 3))
    level = cv2.blur(fringes.astype(np.float64) - black, (3, 3))
    wave = np.where(lit, level / np.maximum(contrast, 1), 0)
    inner = cv2.erode(lit.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not inner.any():
        return FringeTrial(period, 0.0, 0.0)
    middle = float(wave[inner].mean())
    variance = float(np.mean((wave[inner] - middle) ** 2))
    by_v, by_u = np.gradient(wave)
    slope = float(np.mean((by_u**2 + by_v**2)[inner]))
    camera_period = 2 * np.pi * np.sqrt(variance / max(slope, 1e-12))
    return FringeTrial(period, 2 * np.sqrt(2 * variance), float(camera_period))


def best_period(trials: list[FringeTrial]) -> float | None:
    """Return the period with the most information; None if no fringes can be decoded."""
    usable = [trial for trial in trials if trial.is_usable]
    if not usable:
        return None
    return max(usable, key=lambda trial: trial.modulation / trial.period).period
