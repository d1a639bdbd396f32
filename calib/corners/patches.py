"""Sample the pixels that measure a corner: those along its two edges, on half of the way to the
neighbouring corners.

Every pixel belongs to one corner alone, so the errors of two corners are independent. Pixels far
from both edges have no information on the place. Where squares are large, only every second, third
... pixel along an edge is taken, which limits the time for a corner.

A pixel is described by its position (u, v) between the neighbouring corners. The distances from
both curved edges, the position along them, and the light are polynomials of first or second degree
in u and v, and one product of small matrices evaluates them for all pixels.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice

REACH = 0.5  # of the way to the neighbours

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """P pixels along each edge of N corners: T places from the corner outwards, on both sides of it
    alike, and at each place the pixels across the edge.

    An edge is a row: the first edges of all corners stand before the second ones. A row's own edge
    is the one that it follows; the crossing edge is the corner's other one.
    """

    light: Floats
    """(2N, P) grey levels."""
    forms: Floats
    """(6, 2N, P) the monomials 1, u, v, u^2, u v, v^2: u runs along the own edge and v along the
    crossing one, both from -1 to 1 over the patch.
    """
    used: Floats
    """(2N, P) 1, or 0 where the pixel lies outside the picture or belongs to the other row."""
    facing: Floats
    """(2N, P) -1 or 1, the side of the crossing edge."""
    crossing_distance: Floats
    """(P,) px, a lower bound of the distance to the crossing edge in all rows, for this pixel and
    all after it.
    """
    ends: NDArray[np.float64]
    """(2N, 2, 2) px, from the corner to where u is 1, and to where v is 1."""
    places: NDArray[np.intp]
    """(T,) whole numbers, negative on one side of the corner, ordered by size."""

    @property
    def pixels_across(self) -> int:
        """The number of pixels at each place."""
        return int(self.light.shape[1]) // len(self.places)

    def of_corners(self, corners: NDArray[np.intp]) -> "Patches":
        """Return the patches of the corners at (K,) indices."""
        rows = np.concatenate([corners, corners + len(self.light) // 2])
        return Patches(
            light=self.light[rows],
            forms=self.forms[:, rows],
            used=self.used[rows],
            facing=self.facing[rows],
            crossing_distance=self.crossing_distance,
            ends=self.ends[rows],
            places=self.places,
        )

    def thinned(self, count: int) -> "Patches":
        """Return the patches with about `count` equally spaced places."""
        selected = np.flatnonzero(self.places % max(len(self.places) // count, 1) == 0)

        def select(values: Floats) -> Floats:
            by_place = values.reshape(*values.shape[:-1], -1, self.pixels_across)
            return by_place.take(selected, -2).reshape(*values.shape[:-1], -1)

        return Patches(
            light=select(self.light),
            forms=select(self.forms),
            used=select(self.used),
            facing=select(self.facing),
            crossing_distance=select(self.crossing_distance),
            ends=self.ends,
            places=self.places[selected],
        )


def sample_patches(grey: NDArray, lattice: Lattice, half_width: int, max_places: int) -> Patches:
    """Sample the patches of a (H, W) picture.

    Args:
        grey: (H, W).
        lattice: the N corners.
        half_width: px on both sides of an edge.
        max_places: places along an edge, at most.
    """
    ends = REACH * np.concatenate([lattice.steps, lattice.steps[:, ::-1]])
    flat = np.abs(ends[:, 0, 0]) >= np.abs(ends[:, 0, 1])  # the edge runs more along x than along y
    # px along the edge's main axis and across it
    own_end, crossing_end = np.where(flat[:, None, None], ends, ends[..., ::-1]).swapaxes(0, 1)
    corners = np.concatenate([lattice.corners, lattice.corners])
    rounded = np.rint(corners)
    shift = np.where(flat[:, None], rounded - corners, (rounded - corners)[:, ::-1])
    # the longest of all first edges, and of the second ones
    farthest = np.ceil(np.abs(own_end[:, 0]).reshape(2, -1).max(1)).astype(np.intp)
    stride = -(-(2 * farthest + 1) // max_places)
    last = int((farthest // stride).max())
    places = np.array(sorted(range(-last, last + 1), key=abs), np.intp)
    main_offset = places * np.repeat(stride, len(lattice.corners))[:, None]  # (2N, T) whole px
    cross_offset = np.arange(-half_width, half_width + 1)
    run = main_offset + shift[:, :1]  # px from the corner
    middle = np.rint(run * (own_end[:, 1] / own_end[:, 0])[:, None] - shift[:, 1:])  # whole px
    forms = _forms(own_end, crossing_end, run, middle + shift[:, 1:], cross_offset)

    # times both lengths
    sine = own_end[:, 0] * crossing_end[:, 1] - own_end[:, 1] * crossing_end[:, 0]
    u_size = np.abs(forms[1])
    v_size = np.abs(forms[2])
    used = np.maximum(u_size, v_size) <= 1
    if np.isfinite(lattice.clearance):
        used &= np.minimum(u_size, v_size) <= lattice.clearance / REACH
    second = slice(len(lattice.corners), None)
    # how far the pixels of the crossing edge extend
    crossing_band = (half_width + 0.5) * np.abs(crossing_end[second]).max(1) / np.abs(sine[second])
    used[second] &= u_size[second] > crossing_band.astype(np.float32)[:, None]
    u_size *= (np.abs(sine) / np.linalg.norm(crossing_end, axis=1)).astype(np.float32)[:, None]
    crossing_distance = np.minimum.accumulate(u_size.min(0)[::-1])[::-1]

    height, width = grey.shape
    # from pixel to pixel along the edge's main axis, and across it
    steps = np.where(flat[:, None], (1, width), (width, 1))
    start = rounded[:, 0].astype(np.intp) + width * rounded[:, 1].astype(np.intp)
    index = start[:, None] + steps[:, :1] * main_offset + steps[:, 1:] * middle.astype(np.intp)
    light = np.take(grey, index[..., None] + steps[:, 1:, None] * cross_offset, mode="clip")
    light = light.reshape(used.shape)
    margin = max(int(np.abs(main_offset).max()), int(np.abs(middle).max()) + half_width)
    at_border = ((rounded < margin) | (rounded + margin >= (width, height))).any(1)
    for row in np.flatnonzero(at_border).tolist():
        main = main_offset[row][:, None]
        cross = middle[row][:, None] + cross_offset
        x = (main if flat[row] else cross) + rounded[row, 0]
        y = (cross if flat[row] else main) + rounded[row, 1]
        used[row] &= ((x >= 0) & (x < width) & (y >= 0) & (y < height)).ravel()
    # the side of the crossing edge where the own edge ends along its main axis
    end_side = np.where(flat, -1, 1) * np.sign(sine * own_end[:, 0])
    facing = end_side.astype(np.float32)[:, None] * np.repeat(
        np.where(places < 0, -1, 1).astype(np.float32), len(cross_offset)
    )
    return Patches(
        light=light.astype(np.float32),
        forms=forms,
        used=used.astype(np.float32),
        facing=facing,
        crossing_distance=crossing_distance,
        ends=ends,
        places=places,
    )


def _forms(
    own_end: NDArray, crossing_end: NDArray, run: NDArray, middle: NDArray, cross_offset: NDArray
) -> Floats:
    """Return the (6, R, P) monomials.

    Args:
        own_end: (R, 2) px to u = 1, along the own edge's main axis and across it.
        crossing_end: (R, 2) px to v = 1, likewise.
        run: (R, T) px of the places along the main axis.
        middle: (R, T) px of the places across it.
        cross_offset: px of the pixels across it, from the middle.
    """
    # (u and v, R, axes, 1)
    from_px = np.linalg.inv(np.stack([own_end, crossing_end], -1)).swapaxes(0, 1)[..., None]
    # u and v of the middle pixel, and their change for each px across
    places = np.empty((2, *run.shape, 2), np.float32)
    places[..., 0] = from_px[:, :, 0] * run + from_px[:, :, 1] * middle
    places[..., 1] = from_px[:, :, 1]
    forms = np.empty((6, *run.shape, len(cross_offset)), np.float32)
    forms[0] = 1
    basis = np.stack([np.ones_like(cross_offset), cross_offset]).astype(np.float32)
    np.matmul(places, basis, out=forms[1:3])
    np.multiply(forms[1], forms[1], out=forms[3])
    np.multiply(forms[1], forms[2], out=forms[4])
    np.multiply(forms[2], forms[2], out=forms[5])
    return forms.reshape(6, len(run), -1)
