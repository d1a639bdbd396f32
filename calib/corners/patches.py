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
        pixels = np.concatenate([first_pixels, second_pixels], 1)
        again = np.concatenate([np.zeros(first_pixels.shape[:2], bool), first.holds(second_pixels)], 1)
        places = pixels + shift[:, None]  # (N, all, 2) px from the corner
        parts = np.abs(np.matmul(places, np.linalg.inv(lattice.steps).astype(np.float32)))
        at = pixels.astype(np.int32) + whole.astype(np.int32)[:, None]
        inside = ((at >= 0) & (at < (grey.shape[1], grey.shape[0]))).all(-1)
        used = inside & ~again & (parts.max(-1) <= REACH)
        order = np.argsort(~used, 1, kind="stable")[:, : max(int(used.sum(1).max()), 1)]
        used = np.take_along_axis(used, order, 1)
        at = np.where(used[..., None], np.take_along_axis(at, order[..., None], 1), 0)
        x, y = (np.take_along_axis(places[..., axis], order, 1) for axis in (0, 1))
        size = REACH * np.linalg.norm(lattice.steps, axis=-1).mean(-1, keepdims=True)
        light = grey[at[..., 1], at[..., 0]].astype(np.float32)
        return Patches(light, x, y, used.astype(np.float32), size.astype(np.float32), half_width)

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

    def pixels(self) -> Floats:
        """(N, T * width, 2) whole px."""
        across = np.arange(-self.half_width, self.half_width + 1, dtype=np.float32)
        other = self._middle(self.along[None])[..., None] + across  # (N, T, width)
        along = np.broadcast_to(self.along[:, None], other.shape)
        pairs = np.stack([along, other], -1).reshape(len(self.flat), -1, 2)
        return np.where(self.flat[:, None, None], pairs, pairs[..., ::-1])

    def holds(self, pixels: Floats) -> NDArray[np.bool_]:
        """(N, P) whether (N, P, 2) whole px are in it."""
        own = np.where(self.flat[:, None, None], pixels, pixels[..., ::-1])
        return np.asarray(np.abs(own[..., 1] - self._middle(own[..., 0])) <= self.half_width)

    def _middle(self, along: Floats) -> Floats:
        """(N, P) whole px, where the edge is across its axis, of (N or 1, P) px."""
        return np.asarray(np.rint((along + self.shift[:, :1]) * self.rise[:, None] - self.shift[:, 1:]))
