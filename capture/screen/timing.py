"""How soon a camera sees what the page has shown, and whether the screen's light flickers.

A picture may be older than its time stamp says, and a screen shows what a browser has drawn some
refreshes later. So nobody relies on either: white is shown after black, and the time until the
camera's pictures have stopped to change is measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError

Floats = NDArray[np.float64]

WATCHED_S = 1.0
"""s, for which the change from black to white is watched."""
MIN_PICTURES = 10
"""Pictures of white that tell a flicker."""
SETTLED = 0.02
"""The difference to the final level over the contrast, from which a picture counts as settled."""
FLICKER_SPREADS = 4.0
"""Standard deviations of a flickering level that are no change."""
MAX_LAG_S = 0.7
"""s, above which it is not the screen that is slow: the camera adapts itself to the light."""
GREY_FACTOR = 1.5
"""Some screens take longer from grey to grey than from black to white."""
MARGIN_S = 0.02
"""s, a refresh and a bit."""
MIN_LAG_S = 0.03
"""s, of two refreshes. A network that held up the page's word would make a lag look shorter."""
CHANGES = 3
"""Changes between black and white that are watched; the longest lag counts."""
MIN_CONTRAST = 8.0
"""Grey levels between black and white, below which the camera does not see the screen (as
`calib.fringes.decode`).
"""
MAX_FLICKER = 0.005
"""Of the light, above which a flicker is told: 1 grey level of 200, half of a camera's noise."""
MULTIPLE = 0.03
"""Of a refresh, within which an exposure is a multiple of it."""


@dataclass(frozen=True, slots=True)
class ScreenTiming:
    """The timing of a screen and a camera."""

    lag_s: float
    """s from the page's word to the first picture that shows it."""
    flicker: float
    """The relative standard deviation of the rows of white pictures."""

    @property
    def settle_s(self) -> float:
        """The time in s from the page's word on, in which no picture is taken."""
        return GREY_FACTOR * max(self.lag_s, MIN_LAG_S) + MARGIN_S


def lit_pixels(black: NDArray[np.uint8], white: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return (H, W) true where a camera sees the screen.

    Raises:
        InputError: it does not see it anywhere.
    """
    contrast = cv2.blur(white.astype(np.float64) - black, (5, 5))
    lit = contrast > max(MIN_CONTRAST, float(np.quantile(contrast, 0.99)) / 2)
    if lit.mean() < 1e-3:
        raise InputError(
            "The camera does not see the screen: turn both to each other, take the lens cap off,"
            " or lengthen the exposure."
        )
    return np.asarray(lit)


def measure_timing(
    previous: NDArray[np.uint8],
    pictures: Sequence[NDArray[np.uint8]],
    times_s: Sequence[float],
) -> ScreenTiming:
    """Return the timing that pictures show, taken while white follows black or black white.

    Args:
        previous: (H, W) grey, of the level before.
        pictures: (H, W) grey each.
        times_s: s, their exposures after the page's word that the level has changed.

    Raises:
        InputError: the camera does not see the screen, or its pictures do not stop to change.
    """
    last = pictures[-1]
    is_white = float(last.mean()) > float(previous.mean())
    lit = lit_pixels(previous, last) if is_white else lit_pixels(last, previous)
    shares = lit.sum(1)
    rows = shares > shares.max() / 4
    profiles = np.array(
        [np.where(lit, picture, 0).sum(1)[rows] / shares[rows] for picture in pictures]
    )
    levels = profiles.mean(1)
    middle = len(levels) // 2
    late = levels[middle:]
    final = float(np.median(late))
    contrast = abs(final - float(previous[lit].mean()))
    tolerance = max(SETTLED * contrast, FLICKER_SPREADS * float(late.std()))
    changing = np.flatnonzero(np.abs(levels - final) > tolerance)
    first = int(changing[-1]) + 1 if len(changing) else 0
    drift = abs(float(late[-3:].mean()) - float(late[:3].mean()))
    if first > middle or times_s[first] > MAX_LAG_S or drift > SETTLED * contrast:
        raise InputError(
            "The camera's pictures go on changing after the screen has: lock its exposure and white"
            " balance (exposure_us=... after the source), and keep its light steady."
        )
    settled = profiles[first:]
    flicker = float((settled / settled.mean(0)).std(0).mean()) if is_white else 0.0
    return ScreenTiming(times_s[first], flicker)


def timing_sentences(
    timing: ScreenTiming, refresh_hz: float, exposure_us: float | None
) -> list[str]:
    """Return what a person should know of the timing."""
    period_us = 1e6 / refresh_hz
    exposure = "" if exposure_us is None else f", exposure {exposure_us / 1000:.1f} ms"
    sentences = [
        f"The screen is seen {1000 * timing.lag_s:.0f} ms after it was drawn, refresh"
        f" {refresh_hz:.1f} Hz{exposure}, flicker {100 * timing.flicker:.2f} % of its light."
    ]
    cycles = 0.0 if exposure_us is None else exposure_us / period_us
    is_multiple = round(cycles) >= 1 and abs(cycles - round(cycles)) < MULTIPLE
    if timing.flicker > MAX_FLICKER:
        advice = "set the screen to full brightness"
        if not is_multiple:
            advice = (
                f"expose for a multiple of its refresh, ?exposure_us={period_us:.0f} or"
                f" {2 * period_us:.0f}, or {advice}"
            )
        sentences.append(
            f"The screen's light flickers from picture to picture, which makes points less exact:"
            f" {advice}."
        )
    return sentences
