"""Pictures that show two patterns at once, or the one before: the screen was late, or tore."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.fringes.pattern import FringePlan, Unwrapping

Floats = NDArray[np.float64]

WINDOW = 15
"""px, the width of the window in which pictures are compared."""
MAX_EXCESS = 0.05
"""The part of the energy of the fringes by which those of one frequency may differ more from a wave
than others of the same axis. A picture of the pattern before it makes 0.11. A screen's gamma of 2.2
makes 0.02 in all of them alike.
"""
MIN_AMPLITUDE = 8.0
"""Grey levels of a fringe, below which noise hides what a picture shows."""
MAX_FLAT_CHANGE = 0.2
"""The part of the contrast by which black and white may change between two of their pictures."""


def torn_share(
    frames: Sequence[NDArray[np.uint8]],
    plan: FringePlan,
    black: NDArray[np.uint8],
    white: NDArray[np.uint8],
    lit: NDArray[np.bool_],
) -> float:
    """Return the share of the screen's pixels in which a picture does not show its pattern, 0 to 1.

    Args:
        frames: (H, W) grey each, in the order of `FringePlan.draw`.
        plan: of three frequencies for each axis.
        black: (H, W) grey, of a black screen before.
        white: (H, W) grey, of a white screen before.
        lit: (H, W) true for the pixels that see the screen.
    """
    assert plan.unwrapping is Unwrapping.HETERODYNE
    contrast = _mean(white.astype(np.float64) - black)
    torn = np.zeros_like(lit)
    for first, second in zip((black, white), frames[:2], strict=True):
        change = np.abs(_mean(second.astype(np.float64) - first))
        torn |= change > MAX_FLAT_CHANGE * contrast
    begin = 2
    for axis in (0, 1):
        misfits = []
        energies = []
        for _ in plan.fringes(axis):
            misfit, energy = _wave_misfit(frames[begin : begin + plan.steps])
            misfits.append(misfit)
            energies.append(energy)
            begin += plan.steps
        energy = np.median(energies, axis=0)
        excess = np.max(misfits, axis=0) - np.median(misfits, axis=0)
        torn |= (excess > MAX_EXCESS * energy) & (energy > plan.steps / 2 * MIN_AMPLITUDE**2)
    return float(torn[lit].mean())


def _wave_misfit(series: Sequence[NDArray[np.uint8]]) -> tuple[Floats, Floats]:
    """Return (H, W) squared grey levels, around each pixel: the sum of squares of what is not a
    wave in equal steps, and that of the wave.
    """
    steps = len(series)
    turns = np.exp(2j * np.pi * np.arange(steps) / steps)
    levels = [frame.astype(np.float64) for frame in series]
    middle = sum(levels) / steps
    phasor = sum(turn * level for turn, level in zip(turns, levels, strict=True)) * 2 / steps
    waves = [middle + np.real(phasor * turn.conjugate()) for turn in turns]
    errors = [np.square(level - wave) for level, wave in zip(levels, waves, strict=True)]
    return _mean(np.sum(errors, axis=0)), _mean(steps / 2 * np.square(np.abs(phasor)))


def _mean(values: Floats) -> Floats:
    return np.asarray(cv2.blur(values, (WINDOW, WINDOW)), np.float64)
