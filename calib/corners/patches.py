"""Which pixels measure a corner: those along its two edges, half of the way to the neighbouring corners.

Every pixel belongs to one corner alone, so that the errors of two corners are independent. Pixels far from both edges say nothing of the
place. Where squares are large, only every second, third ... pixel along an edge is taken, so that a corner costs no more than so much.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice

REACH = 0.5  # of the way to the neighbours

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """P pixels around each of N corners: those about one edge, then the other's, each from the corner outwards, to both sides alike. The
    fullest patch sets P."""

    light: Floats
    """(N, P) grey levels."""
    x: Floats
    """(N, P) px, from the corner as the lattice has it."""
    y: Floats
    """(N, P) px."""
    used: Floats
    """(N, P) 1, or 0 where there is no such pixel."""
    size: Floats
    """(N, 1) px, half the patch's extent."""
    half_width: int
    """px to both sides of an edge."""

    @staticmethod
    def of(grey: NDArray, lattice: Lattice, half_width: int, most: int) -> "Patches":
        """From a (H, W) picture, at no more than `most` places along an edge."""
        whole = np.rint(lattice.corners)
        shift = (whole - lattice.corners).astype(np.float32)
        first, second = (_Band.of(lattice.steps[:, edge], shift, half_width, most) for edge in (0, 1))
        first_pixels, second_pixels = first.pixels(), second.pixels()
        again = np.concatenate([np.zeros(first_pixels[0].shape, bool), first.holds(*second_pixels)], 1)
        across, down = (np.concatenate(both, 1) for both in zip(first_pixels, second_pixels, strict=True))
        x, y = across + shift[:, :1], down + shift[:, 1:]
        along_row, along_column = np.moveaxis(np.linalg.inv(lattice.steps).astype(np.float32)[:, :, None], -1, 0)  # (N, 2, 1) each
        by_row, by_column = (np.abs(x * along[:, 0] + y * along[:, 1]) for along in (along_row, along_column))
        near = (np.maximum(by_row, by_column) <= REACH) & (np.minimum(by_row, by_column) <= lattice.clear)
        column, row = (pixels.astype(np.int32) + own.astype(np.int32)[:, None] for pixels, own in zip((across, down), whole.T, strict=True))
        used = near & ~again & (column >= 0) & (column < grey.shape[1]) & (row >= 0) & (row < grey.shape[0])
        places = np.flatnonzero(used)
        counts = used.sum(1)
        fullest = max(int(counts.max()), 1)
        shifts = np.arange(len(counts)) * fullest - np.concatenate([[0], np.cumsum(counts)[:-1]])
        packed = np.arange(len(places)) + np.repeat(shifts, counts)
        pixels = np.zeros((4, len(counts), fullest), np.float32)
        seen = grey[row.ravel()[places], column.ravel()[places]]
        for part, values in zip(pixels, (seen, x.ravel()[places], y.ravel()[places], 1), strict=True):
            part.ravel()[packed] = values
        size = REACH * np.linalg.norm(lattice.steps, axis=-1).mean(-1, keepdims=True)
        return Patches(pixels[0], pixels[1], pixels[2], pixels[3], size.astype(np.float32), half_width)

    def some(self, corners: slice) -> "Patches":
        """Those of a few corners."""
        light, x, y, used, size = (part[corners] for part in (self.light, self.x, self.y, self.used, self.size))
        return Patches(light, x, y, used, size, self.half_width)


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """The pixels about one edge of each corner, counted from the pixel that the corner is in."""

    flat: NDArray[np.bool_]
    """(N,) whether the edge runs more along x than along y."""
    rise: Floats
    """(N,) px along the other axis for each along that one."""
    shift: Floats
    """(N, 2) px, from the corner to its pixel; along the edge's axis first."""
    along: Floats
    """(T,) px."""
    half_width: int

    @staticmethod
    def of(steps: NDArray[np.float64], shift: Floats, half_width: int, most: int) -> "_Band":
        flat = np.abs(steps[:, 0]) >= np.abs(steps[:, 1])
        run, climb = np.where(flat, steps.T, steps.T[::-1])
        ends = int(np.ceil(REACH * np.abs(run).max()))
        stride = -(-(2 * ends + 1) // most)
        along = np.array(sorted(range(-(ends // stride), ends // stride + 1), key=abs)) * stride
        own = np.where(flat[:, None], shift, shift[:, ::-1])
        return _Band(flat, (climb / run).astype(np.float32), own, along.astype(np.float32), half_width)

    def pixels(self) -> tuple[Floats, Floats]:
        """(N, T * width) whole px along x, and along y."""
        across = np.arange(-self.half_width, self.half_width + 1, dtype=np.float32)
        other = self._middle(self.along[None])[..., None] + across  # (N, T, width)
        along = np.broadcast_to(self.along[:, None], other.shape)
        flat = self.flat[:, None]
        along, other = (part.reshape(len(flat), -1) for part in (along, other))
        return np.where(flat, along, other), np.where(flat, other, along)

    def holds(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """(N, P) whether (N, P) whole px are in it."""
        flat = self.flat[:, None]
        along, other = np.where(flat, x, y), np.where(flat, y, x)
        return np.asarray(np.abs(other - self._middle(along)) <= self.half_width)

    def _middle(self, along: Floats) -> Floats:
        """(N, P) whole px, where the edge is across its axis, of (N or 1, P) px."""
        return np.asarray(np.rint((along + self.shift[:, :1]) * self.rise[:, None] - self.shift[:, 1:]))
