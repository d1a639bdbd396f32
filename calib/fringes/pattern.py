"""The patterns that a screen shows one after another, so that a camera can tell which place of the
screen each of its pixels sees.

Each axis has fringes of several close frequencies, shifted in equal steps. The beats of the
frequencies count the fringes (a heterodyne): for k = 10 there are 100, 99 and 90 fringes, whose
beats are 1 and 10. So every picture has fine fringes and adds to the accuracy. The fallback is two
frequencies; a Gray code numbers the half fringes of the first.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError

MIN_STEPS = 5
"""With N steps, the harmonics of orders N - 1, N + 1, 2 N - 1 ... bias the phase. A screen's gamma
of 2.2 has a second harmonic of 14 % and a third of 0.6 %, which 3 and 4 steps would take in.
"""
MARGIN = 1.05
"""The beat of one fringe is longer than the screen by this factor: its ends stay apart."""
MIN_PERIOD = 4.0
"""Screen pixels in a fringe, so that it is drawn as a wave."""
WHITE = 255


class Unwrapping(StrEnum):
    """The way in which fringes are counted."""

    HETERODYNE = "heterodyne"
    GRAY = "gray"


@dataclass(frozen=True, slots=True)
class Screen:
    """A flat screen. Its frame has its origin in the middle, x along the rows of its pixels, y down
    and z away from the viewer.
    """

    width: int
    """px"""
    height: int
    """px"""
    pitch: tuple[float, float]
    """m from pixel to pixel along x and y."""

    @property
    def size(self) -> tuple[int, int]:
        """The numbers of pixels along x and y."""
        return self.width, self.height


@dataclass(frozen=True, slots=True, eq=False)
class ScreenPattern:
    """One drawing of a screen, as the product of two lines of grey levels."""

    columns: NDArray[np.uint8]
    """(width,) the level of each column."""
    rows: NDArray[np.uint8]
    """(height,) the level of each row; WHITE leaves the columns as they are."""

    def draw(self) -> NDArray[np.uint8]:
        """Return the (height, width) picture."""
        product = np.multiply.outer(self.rows.astype(np.uint16), self.columns)
        return ((product + WHITE // 2) // WHITE).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class FringePlan:
    """The fringes of one series of pictures."""

    screen: Screen
    period: float
    """Screen pixels of the finest fringe wanted. The best is 2 pi times the blur (standard
    deviation): a shorter fringe loses its contrast, a longer one its slope.
    """
    steps: int = MIN_STEPS
    unwrapping: Unwrapping = Unwrapping.HETERODYNE

    def __post_init__(self) -> None:
        if self.steps < MIN_STEPS:
            raise InputError(
                f"{self.steps} phase steps leave the screen's gamma in the phase: take at least"
                f" {MIN_STEPS}."
            )
        if not MIN_PERIOD <= self.period <= min(self.screen.size) / 4:
            raise InputError(
                f"A fringe of {self.period:g} screen pixels cannot be drawn or counted: take"
                f" {MIN_PERIOD:g} to {min(self.screen.size) / 4:g}."
            )

    def extent(self, axis: int) -> float:
        """Return the screen pixels over which the fringes of an axis are counted."""
        return MARGIN * self.screen.size[axis]

    def fringes(self, axis: int) -> tuple[int, ...]:
        """Return the numbers of fringes over the extent of an axis, the largest first."""
        if self.unwrapping == Unwrapping.GRAY:
            finest = round(self.extent(axis) / self.period)
            return finest, finest - 1
        beat = max(2, round((self.extent(axis) / self.period) ** 0.5))
        return beat**2, beat**2 - 1, beat**2 - beat

    def bits(self, axis: int) -> int:
        """Return the number of bits of an axis' Gray code."""
        if self.unwrapping != Unwrapping.GRAY:
            return 0
        return (2 * self.fringes(axis)[0] - 1).bit_length()

    @property
    def count(self) -> int:
        """The number of pictures: black, white, then for x and y the fringes and the Gray code."""
        return 2 + sum(self.steps * len(self.fringes(axis)) + self.bits(axis) for axis in (0, 1))

    def patterns(self) -> Iterator[ScreenPattern]:
        """Yield what the screen shows, in the order of the pictures."""
        white = [np.full(size, WHITE, np.uint8) for size in self.screen.size]
        yield ScreenPattern(np.zeros_like(white[0]), white[1])
        yield ScreenPattern(white[0], white[1])
        for line in self._lines(0):
            yield ScreenPattern(line, white[1])
        for line in self._lines(1):
            yield ScreenPattern(white[0], line)

    def draw(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width) pictures in their order."""
        return (pattern.draw() for pattern in self.patterns())

    def _lines(self, axis: int) -> Iterator[NDArray[np.uint8]]:
        """Yield the grey levels along an axis, a row for each picture."""
        size = self.screen.size[axis]
        place = (np.arange(size) - (size - 1) / 2) / self.extent(axis) + 0.5  # of the extent
        for fringes in self.fringes(axis):
            for step in range(self.steps):
                wave = np.cos(2 * np.pi * (fringes * place - step / self.steps))
                yield np.rint(WHITE * (1 + wave) / 2).astype(np.uint8)
        cell = np.floor(2 * self.fringes(axis)[0] * place).astype(np.int64)
        code = cell ^ (cell >> 1)
        for bit in reversed(range(self.bits(axis))):
            yield (WHITE * ((code >> bit) & 1)).astype(np.uint8)
