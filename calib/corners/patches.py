"""Which pixels measure a corner: those along its two edges, half of the way to the neighbouring
corners.

Every pixel belongs to one corner alone, so that the errors of two corners are independent. Pixels
far from both edges say nothing of the place. Where squares are large, only every second, third ...
pixel along an edge is taken, so that a corner costs no more than so much.

Pixels are known by where they lie between the neighbouring corners: the distances from both edges,
bent as they may be, the way along them, and the light are forms of that, of the first or second
degree, and one product of small matrices gives them for all pixels.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice

REACH = 0.5  # of the way to the neighbours

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """P pixels along each edge of N corners: T places from the corner outwards, to both sides
    alike, and at each the pixels across. An edge
    is a row: the first edges of all corners stand before the second ones. What is a row's `own` is
        along or across its edge, the `other`
    edge is the corner's other one.
    """

    light: Floats
    """(2N, P) grey levels."""
    forms: Floats
    """(6, 2N, P) 1, u, v, u^2, u v, v^2: u goes along the own edge and v along the other, both from
    -1 to 1 over the patch.
    """
    used: Floats
    """(2N, P) 1, or 0 where there is no such pixel, or it is the other row's."""
    facing: Floats
    """(2N, P) -1 or 1, the side of the other edge."""
    away: Floats
    """(P,) px to the other edge, at least, in any row, from this pixel on outwards."""
    ends: NDArray[np.float64]
    """(2N, 2, 2) px, from the corner to where u is 1, and to where v is."""
    places: NDArray[np.intp]
    """(T,) whole numbers, on one side of the corner and on the other."""

    @property
    def across(self) -> int:
        """Pixels at each place."""
        return int(self.light.shape[1]) // len(self.places)

    def of_corners(self, corners: NDArray[np.intp]) -> "Patches":
        """Those of a few."""
        rows = np.concatenate([corners, corners + len(self.light) // 2])
        light, used, facing = (part[rows] for part in (self.light, self.used, self.facing))
        return Patches(
            light, self.forms[:, rows], used, facing, self.away, self.ends[rows], self.places
        )

    def thinned(self, fewest: int) -> "Patches":
        """At equal distances, as far apart as leaves so many places."""
        kept = np.flatnonzero(self.places % max(len(self.places) // fewest, 1) == 0)
        light, forms, used, facing, away = (
            part.reshape(*part.shape[:-1], -1, self.across)
            .take(kept, -2)
            .reshape(*part.shape[:-1], -1)
            for part in (self.light, self.forms, self.used, self.facing, self.away)
        )
        return Patches(light, forms, used, facing, away, self.ends, self.places[kept])


def patches_of(grey: NDArray, lattice: Lattice, half_width: int, most: int) -> Patches:
    """From a (H, W) picture, at no more than `most` places along an edge, so many px to both
    sides.
    """
    ends = REACH * np.concatenate([lattice.steps, lattice.steps[:, ::-1]])
    flat = np.abs(ends[:, 0, 0]) >= np.abs(ends[:, 0, 1])  # the edge runs more along x than along y
    own, other = np.where(flat[:, None, None], ends, ends[..., ::-1]).swapaxes(
        0, 1
    )  # px along that axis and across it
    corners = np.concatenate([lattice.corners, lattice.corners])
    whole = np.rint(corners)
    shift = np.where(flat[:, None], whole - corners, (whole - corners)[:, ::-1])
    farthest = np.ceil(np.abs(own[:, 0]).reshape(2, -1).max(1)).astype(
        np.intp
    )  # of all first edges, and of the second ones
    stride = -(-(2 * farthest + 1) // most)
    last = int((farthest // stride).max())
    places = np.array(sorted(range(-last, last + 1), key=abs), np.intp)
    along = places * np.repeat(stride, len(lattice.corners))[:, None]  # (2N, T) whole px
    across = np.arange(-half_width, half_width + 1)
    run = along + shift[:, :1]  # px from the corner
    middle = np.rint(run * (own[:, 1] / own[:, 0])[:, None] - shift[:, 1:])  # whole px
    forms = _forms(own, other, run, middle + shift[:, 1:], across)

    sine = own[:, 0] * other[:, 1] - own[:, 1] * other[:, 0]  # times both lengths
    beside, beyond = np.abs(forms[1]), np.abs(forms[2])
    used = np.maximum(beside, beyond) <= 1
    if np.isfinite(lattice.clear):
        used &= np.minimum(beside, beyond) <= lattice.clear / REACH
    second = slice(len(lattice.corners), None)
    other_band = (
        (half_width + 0.5) * np.abs(other[second]).max(1) / np.abs(sine[second])
    )  # how far the other edge's pixels go
    used[second] &= beside[second] > other_band.astype(np.float32)[:, None]
    beside *= (np.abs(sine) / np.linalg.norm(other, axis=1)).astype(np.float32)[:, None]
    away = np.minimum.accumulate(beside.min(0)[::-1])[::-1]

    height, width = grey.shape
    steps = np.where(
        flat[:, None], (1, width), (width, 1)
    )  # from pixel to pixel along the edge, and across
    begin = whole[:, 0].astype(np.intp) + width * whole[:, 1].astype(np.intp)
    index = begin[:, None] + steps[:, :1] * along + steps[:, 1:] * middle.astype(np.intp)
    light = np.take(grey, index[..., None] + steps[:, 1:, None] * across, mode="clip").reshape(
        used.shape
    )
    margin = max(int(np.abs(along).max()), int(np.abs(middle).max()) + half_width)
    for row in np.flatnonzero(
        ((whole < margin) | (whole + margin >= (width, height))).any(1)
    ).tolist():
        ways = along[row][:, None], middle[row][:, None] + across
        x, y = (
            way + of for way, of in zip(ways if flat[row] else ways[::-1], whole[row], strict=True)
        )
        used[row] &= ((x >= 0) & (x < width) & (y >= 0) & (y < height)).ravel()
    turned = np.where(flat, -1, 1) * np.sign(
        sine * own[:, 0]
    )  # the side of the other edge where the own one ends along its axis
    facing = turned.astype(np.float32)[:, None] * np.repeat(
        np.where(places < 0, -1, 1).astype(np.float32), len(across)
    )
    return Patches(
        light.astype(np.float32), forms, used.astype(np.float32), facing, away, ends, places
    )


def _forms(own: NDArray, other: NDArray, run: NDArray, middle: NDArray, across: NDArray) -> Floats:
    """(6, R, P), of (R, 2) ends along an edge's axis and across it, and (R, T) px along and across,
    around which pixels are taken.
    """
    from_px = np.linalg.inv(np.stack([own, other], -1)).swapaxes(0, 1)[
        ..., None
    ]  # (u and v, R, axes, 1)
    places = np.empty(
        (2, *run.shape, 2), np.float32
    )  # of the pixel in the middle, and for each px across
    places[..., 0] = from_px[:, :, 0] * run + from_px[:, :, 1] * middle
    places[..., 1] = from_px[:, :, 1]
    forms = np.empty((6, *run.shape, len(across)), np.float32)
    forms[0] = 1
    np.matmul(places, np.stack([np.ones_like(across), across]).astype(np.float32), out=forms[1:3])
    for at, (one, two) in enumerate(((1, 1), (1, 2), (2, 2)), 3):
        np.multiply(forms[one], forms[two], out=forms[at])
    return forms.reshape(6, len(run), -1)
