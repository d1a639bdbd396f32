"""What a patch around a corner should look like, and how that changes with each of its parameters.

Two edges meet at the corner, each bent as its neighbours say. Light is an error function of the
distance from an edge: a step, blurred by the lens and by the pixel's own square, whose standard
deviation across an edge is 12^-1/2 px whatever the edge's direction. The product of both edges is
the checkerboard; where the edges are not perpendicular, a blurred corner differs from it by the
correlation of the two distances, of which the first three orders are kept. Uneven light multiplies
all of it. Further from the other edge than its blur and its halo reach, that edge is but a sign.

Sharpening, a curve of tones, and the rounder foot of a real blur are not in the model. They all
leave a corner's picture the same when it is turned by 180 degrees, as the model is: so they can
widen what the fit expects of itself, and not move it to a side.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.patches import Patches

PARAMETERS = (
    *("x", "y", "first angle", "second angle", "first log blur", "second log blur"),
    *("middle", "contrast", "light along the first edge", "light along the second edge", "halo"),
)
"""px from the lattice's corner, rad, logarithms of px, grey levels, and parts of the light over
half a patch.
"""
(
    X,
    Y,
    FIRST_ANGLE,
    SECOND_ANGLE,
    FIRST_BLUR,
    SECOND_BLUR,
    MIDDLE,
    CONTRAST,
    FIRST_LIGHT,
    SECOND_LIGHT,
    HALO_STRENGTH,
) = range(len(PARAMETERS))
PLACE, ANGLES, BLURS, LIGHTS = (
    slice(begin, begin + 2) for begin in (X, FIRST_ANGLE, FIRST_BLUR, FIRST_LIGHT)
)
FIRST_ACROSS, SECOND_ACROSS = (
    X,
    Y,
)  # where derivatives have, in place of x and y, the px across both edges
SECOND_FIRST = [
    1,
    0,
    3,
    2,
    5,
    4,
    6,
    7,
    9,
    8,
    10,
]  # the second edge's parameters before the first one's

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]

HALO = 1.2  # px from an edge, where sharpening's overshoot is largest
FAR, HALO_ENDS = (
    4.5,
    5.0,
    # blurs, and px, from an edge: from there on it is a sign, but for 1e-5 of a step, and 7e-4 of a
    # halo
)
_PEAK = (2 / math.pi) ** 0.5
_STEP = (
    0.7987782,
    0.035297989,
    # tanh of such an odd polynomial is erf(x / sqrt 2), to 3e-4: a pixel is rounded by ten times
    # that
)
_ROWS, _COLUMNS = np.triu_indices(3)
_HALF = np.where(_ROWS == _COLUMNS, 0.5, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """One edge of each row, seen from P pixels."""

    back: Floats
    """(R, P) px along it, towards the corner."""
    beyond: Floats
    """(R, P) blurs, across it."""
    side: Floats
    """(R, P) from -1 to 1, and a halo more."""
    falling: Floats
    """(R, P) how steep the blurred step is, over its peak."""
    halo: Floats
    """(R, P) what sharpening adds to the step, for a strength of 1."""
    halo_falling: Floats
    """(R, P) how steep that is, over its peak."""
    sharpness: Floats
    """(R, 1) 1/px, the step's peak."""
    halo_sharpness: Floats
    """(R, 1) 1/px, the halo's."""

    @staticmethod
    def of(beyond: Floats, ring: Floats, back: Floats, blur: Floats, strength: Floats) -> "_Edge":
        """`ring` is (R, P) HALO, across it."""
        squared = beyond * beyond
        side = squared * _STEP[1]
        side += _STEP[0]
        side *= beyond
        np.tanh(side, out=side)
        squared *= -0.5
        falling = np.exp(squared, out=squared)
        halo_falling = ring * ring
        halo_falling *= -0.5
        np.exp(halo_falling, out=halo_falling)
        halo = ring * halo_falling
        side += halo * strength
        ring *= halo
        halo_falling -= ring
        return _Edge(back, beyond, side, falling, halo, halo_falling, _PEAK / blur, strength / HALO)

    def some(self, rows: slice = slice(None), pixels: slice = slice(None)) -> "_Edge":
        """Of a few rows, from some pixels."""
        seen = (self.back, self.beyond, self.side, self.falling, self.halo, self.halo_falling)
        back, beyond, side, falling, halo, halo_falling = (part[rows, pixels] for part in seen)
        return _Edge(
            back,
            beyond,
            side,
            falling,
            halo,
            halo_falling,
            self.sharpness[rows],
            self.halo_sharpness[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """What the pixels of R rows of patches should look like."""

    light: Floats
    """(R, P) grey levels."""
    own: _Edge
    other: _Edge
    """From those first pixels that are near it."""
    facing: Floats
    """(R, P) from -1 to 1, the side of the other edge."""
    both: Floats
    """(R, near), by how much a blurred corner is not the product of its edges, to the first order.
    """
    pattern: Floats
    """(R, P) from -1 to 1."""
    even: Floats
    """(R, P) grey levels in even light."""
    uneven: Floats
    """(R, P) the light, 1 in the middle."""
    contrast: Floats
    """(R, 1) grey levels."""
    crossing: Floats
    """(R, 1) the sine of the angle from the own edge to the other."""
    u: Floats
    """(R, P) parts of a patch along the own edge."""
    v: Floats
    """(R, P) along the other one."""

    @staticmethod
    def of(parameters: Doubles, patches: Patches, curvatures: Doubles) -> "Expected":
        """
        Args:
            parameters: (R, 11), as in `PARAMETERS`, but the own edge's before the other's.
            patches: R rows.
            curvatures: (R, 2) 1/px, of the own edge and the other.
        """
        angles, blurs = parameters[:, ANGLES], np.exp(parameters[:, BLURS])
        beyond, back = _ways(parameters[:, PLACE], angles, curvatures, patches.ends)
        forms = np.zeros(
            (2, len(parameters), 4, 6), np.float32
        )  # of the own edge, and of the other
        forms[:, :, 0], forms[:, :, 1], forms[:, :, 2] = (
            part.swapaxes(0, 1) for part in (beyond / blurs[..., None], beyond / HALO, back)
        )
        forms[0, :, 3, 0], forms[0, :, 3, 1:3] = 1, parameters[:, LIGHTS]
        middle, contrast, strength, own_blur, other_blur = (
            part.astype(np.float32)[:, None]
            for part in (*parameters[:, [MIDDLE, CONTRAST, HALO_STRENGTH]].T, *blurs.T)
        )
        beyond_own, ring, back_own, uneven = _at(forms[0], patches.forms)
        own = _Edge.of(beyond_own, ring, back_own, own_blur, strength)
        near = int(np.searchsorted(patches.away, max(FAR * float(blurs[:, 1].max()), HALO_ENDS)))
        beyond_other, ring, back_other = _at(forms[1, :, :3], patches.forms[..., :near])
        other = _Edge.of(beyond_other, ring, back_other, other_blur, strength)

        facing = patches.facing.copy()
        facing[:, :near] = other.side
        pattern = own.side * facing
        turn = angles[:, 1] - angles[:, 0]
        slant, crossing = (
            part.astype(np.float32)[:, None] for part in (np.cos(turn), np.sin(turn))
        )
        both = own.falling[:, :near] * other.falling
        both *= _PEAK**2 * slant
        more = own.beyond[:, :near] * other.beyond
        more *= slant / 2  # orders of the slant
        more += 1 + (own.beyond[:, :near] ** 2 - 1) * (other.beyond**2 - 1) * (slant**2 / 6)
        more *= both
        pattern[:, :near] += more
        even = pattern * contrast
        even += middle
        u, v = patches.forms[1:3]
        return Expected(
            even * uneven, own, other, facing, both, pattern, even, uneven, contrast, crossing, u, v
        )

    def some(self, rows: slice) -> "Expected":
        """Of a few rows."""
        parts = (
            self.facing,
            self.both,
            self.pattern,
            self.even,
            self.uneven,
            self.contrast,
            self.crossing,
            self.u,
            self.v,
        )
        return Expected(
            self.light[rows],
            self.own.some(rows),
            self.other.some(rows),
            *(part[rows] for part in parts),
        )

    def derivatives(self, weights: Floats, out: Sequence[Floats]) -> None:
        """Write the derivatives of the light, times (R, P) weights, into eleven (R, P).

        They are by the parameters, the own edge's before the other's; in place of x and y, by the
        px across both edges.
        """
        own, other = self.own, self.other
        near = other.side.shape[1]
        np.multiply(weights, self.uneven, out=out[MIDDLE])
        np.multiply(out[MIDDLE], self.pattern, out=out[CONTRAST])
        lit = weights * self.even
        np.multiply(lit, self.u, out=out[FIRST_LIGHT])
        np.multiply(lit, self.v, out=out[SECOND_LIGHT])
        np.multiply(out[MIDDLE], self.contrast, out=lit)
        facing = lit * self.facing
        np.multiply(facing, own.halo, out=out[HALO_STRENGTH])
        step = facing * own.falling
        np.multiply(step, own.beyond, out=out[FIRST_BLUR])
        out[FIRST_BLUR] *= -_PEAK
        np.multiply(step, own.sharpness, out=out[FIRST_ACROSS])
        facing *= own.halo_falling
        facing *= own.halo_sharpness
        out[FIRST_ACROSS] += facing
        for of_other in (SECOND_ACROSS, SECOND_ANGLE, SECOND_BLUR):
            out[of_other][:, near:] = 0
        self._near(lit[:, :near], own.some(pixels=slice(near)), [one[:, :near] for one in out])
        np.multiply(out[FIRST_ACROSS], own.back, out=out[FIRST_ANGLE])
        closing = lit[:, :near] * own.falling[:, :near]
        closing *= other.falling
        closing *= _PEAK**2 * self.crossing  # of the angle between them
        out[FIRST_ANGLE][:, :near] += closing
        np.multiply(out[SECOND_ACROSS][:, :near], other.back, out=out[SECOND_ANGLE][:, :near])
        out[SECOND_ANGLE][:, :near] -= closing

    def _near(self, lit: Floats, own: _Edge, out: Sequence[Floats]) -> None:
        """Of those pixels that are near both edges, what both change; of the slant, the first
        order.
        """
        other = self.other
        both = lit * self.both
        bent = both * own.beyond
        out[FIRST_ACROSS] -= bent * (own.sharpness / _PEAK)
        bent *= own.beyond
        out[FIRST_BLUR] += bent
        lit = lit * own.side
        out[HALO_STRENGTH] += lit * other.halo
        step = lit * other.falling
        step *= _PEAK
        both *= other.beyond
        step -= both
        np.multiply(step, -other.beyond, out=out[SECOND_BLUR])
        np.multiply(step, other.sharpness / _PEAK, out=out[SECOND_ACROSS])
        lit *= other.halo_falling
        lit *= other.halo_sharpness
        out[SECOND_ACROSS] += lit


def by_distances(parameters: Doubles) -> Doubles:
    """(N, 2, 2) px along x and y that the corner moves, for each px that its pixels move across the
    first edge, and the second.
    """
    first, second = parameters[:, ANGLES].T
    rows = (
        np.stack([-np.cos(second), np.cos(first), -np.sin(second), np.sin(first)], -1)
        / np.sin(second - first)[:, None]
    )
    return np.asarray(rows.reshape(-1, 2, 2))


def _at(forms: Floats, places: Floats) -> Floats:
    """(k, R, P) values of (R, k, 6) forms at (6, R, P)."""
    values = np.empty((forms.shape[1], *places.shape[1:]), np.float32)
    np.matmul(forms, places.swapaxes(0, 1), out=values.swapaxes(0, 1))
    return values


def _ways(
    place: Doubles, angles: Doubles, curvatures: Doubles, ends: Doubles
) -> tuple[Doubles, Doubles]:
    """(R, 2 edges, 6) px across each edge, and px along it towards the corner, as forms."""
    cosine, sine = np.cos(angles), np.sin(angles)
    towards = np.stack([-place, ends[:, 0], ends[:, 1]], -1)  # (R, 2, 3) px for 1, u, v
    along = np.stack([cosine, sine], -1) @ towards
    beyond, back = np.zeros((*angles.shape, 6)), np.zeros((*angles.shape, 6))
    back[..., :3], beyond[..., :3] = -along, np.stack([-sine, cosine], -1) @ towards
    beyond -= (along[..., _ROWS] * along[..., _COLUMNS]) * (curvatures[..., None] * _HALF)
    return beyond, back
