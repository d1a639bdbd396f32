"""What a patch around a corner should look like, and how that changes with each of its parameters.

Two edges meet at the corner, each bent as its neighbours say. Light is an error function of the distance from an edge: a step, blurred by
the lens and by the pixel's own square, whose standard deviation across an edge is 12^-1/2 px whatever the edge's direction. The product
of both edges is the checkerboard; where the edges are not perpendicular, a blurred corner differs from it by the correlation of the two
distances, of which the first three orders are kept. Uneven light multiplies all of it.

Sharpening, a curve of tones, and the rounder foot of a real blur are not in the model. They all leave a corner's picture the same when it
is turned by 180 degrees, as the model is: so they can widen what the fit expects of itself, and not move it to a side.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.patches import Patches

PARAMETERS = (
    *("x", "y", "first angle", "second angle", "first log blur", "second log blur"),
    *("middle", "contrast", "light along x", "light along y", "halo"),
)
X, Y, FIRST_ANGLE, SECOND_ANGLE, FIRST_BLUR, SECOND_BLUR, MIDDLE, CONTRAST, LIGHT_X, LIGHT_Y, HALO_STRENGTH = range(len(PARAMETERS))

Floats = NDArray[np.float32]

TOGETHER = 32  # corners: what they need stays in a processor's cache
HALO = 1.2  # px from an edge, where sharpening's overshoot is largest
_PEAK = (2 / math.pi) ** 0.5
_STEP = (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429)
_STEP_AT = 0.3275911 / 2**0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """One edge of each corner, seen from P pixels."""

    along: Floats
    """(N, P) px from the corner."""
    beyond: Floats
    """(N, P) blurs, across the edge."""
    side: Floats
    """(N, P) from -1 to 1."""
    change: Floats
    """(N, P) of the blurred step, for each blur across."""
    halo: Floats
    """(N, P) what sharpening adds to the step, for a strength of 1."""
    halo_change: Floats
    """(N, P) 1/px, of that, across."""
    sharpness: Floats
    """(N, 1) 1/px, of the blur."""
    cosine: Floats
    """(N, 1) of the edge's direction."""
    sine: Floats

    @staticmethod
    def of(x: Floats, y: Floats, angle: Floats, log_blur: Floats, curvature: Floats, halo: Floats) -> "_Edge":
        cosine, sine, sharpness = np.cos(angle), np.sin(angle), np.exp(-log_blur)
        along = np.asarray(cosine * x + sine * y, np.float32)
        distance = np.asarray(cosine * y - sine * x - 0.5 * curvature * along * along, np.float32)
        beyond, ring = distance * sharpness, distance * (1 / HALO)
        fading = np.exp(-0.5 * ring * ring)
        own_halo, steep = ring * fading, np.asarray((1 - ring * ring) * fading * (1 / HALO), np.float32)
        falling = np.exp(-0.5 * beyond * beyond)
        side = _blurred_step(beyond, falling) + halo * own_halo
        return _Edge(along, beyond, side, _PEAK * falling, own_halo, halo * steep, sharpness, cosine, sine)


def predicted(
    parameters: NDArray[np.float64], patches: Patches, curvatures: NDArray[np.float64], clipped: tuple[float, float]
) -> tuple[Floats, Floats]:
    """The light of every pixel, and its derivatives.

    Args:
        parameters: (N, 11), as in `PARAMETERS`: px from the lattice's corner, rad, logarithms of px, grey levels, and parts of the light
            over half a patch.
        patches: the places.
        curvatures: (N, 2) 1/px, of the two edges.
        clipped: the grey levels that no pixel can fall below or exceed.

    Returns:
        (N, P) grey levels and (N, 11, P). Pixels that are not used, or lie beyond what the sensor can tell, have derivatives of 0.
    """
    light = np.empty_like(patches.light)
    jacobian = np.empty((*parameters.shape, light.shape[1]), np.float32)
    for begin in range(0, len(light), TOGETHER):
        some = slice(begin, begin + TOGETHER)
        own = parameters[some].astype(np.float32)[:, :, None]
        light[some] = _fill(jacobian[some], own, patches.some(some), curvatures[some].astype(np.float32)[:, :, None], clipped)
    return light, jacobian


def _fill(jacobian: Floats, own: Floats, patches: Patches, bent: Floats, clipped: tuple[float, float]) -> Floats:
    """Write the (N, 11, P) derivatives of a few corners into a Jacobian, and return their (N, P) light."""
    x, y = patches.x - own[:, X], patches.y - own[:, Y]
    one = _Edge.of(x, y, own[:, FIRST_ANGLE], own[:, FIRST_BLUR], bent[:, 0], own[:, HALO_STRENGTH])
    two = _Edge.of(x, y, own[:, SECOND_ANGLE], own[:, SECOND_BLUR], bent[:, 1], own[:, HALO_STRENGTH])
    along_x, along_y = patches.x / patches.size, patches.y / patches.size

    slant = one.cosine * two.cosine + one.sine * two.sine
    both = one.change * two.change * slant
    cross = slant * one.beyond * two.beyond
    cubic = slant**2 / 6 * (one.beyond**2 - 1) * (two.beyond**2 - 1)
    pattern = one.side * two.side + both * (1 + cross / 2 + cubic)
    even = own[:, MIDDLE] + own[:, CONTRAST] * pattern
    uneven = 1 + own[:, LIGHT_X] * along_x + own[:, LIGHT_Y] * along_y
    light = uneven * even

    seen = patches.used * ((light > clipped[0]) & (light < clipped[1]))
    lit = seen * own[:, CONTRAST] * uneven
    by_one = lit * (one.change * two.side - both * one.beyond)  # for each blur across; of the slant, the first order
    by_two = lit * (two.change * one.side - both * two.beyond)
    by_px_one = by_one * one.sharpness + lit * one.halo_change * two.side
    by_px_two = by_two * two.sharpness + lit * two.halo_change * one.side
    jacobian[:, X] = one.sine * by_px_one + two.sine * by_px_two
    jacobian[:, Y] = -one.cosine * by_px_one - two.cosine * by_px_two
    closing = lit * one.change * two.change * (one.cosine * two.sine - one.sine * two.cosine)  # of the angle between them
    jacobian[:, FIRST_ANGLE] = closing - one.along * by_px_one
    jacobian[:, SECOND_ANGLE] = -closing - two.along * by_px_two
    jacobian[:, FIRST_BLUR] = -one.beyond * by_one
    jacobian[:, SECOND_BLUR] = -two.beyond * by_two
    jacobian[:, MIDDLE] = seen * uneven
    jacobian[:, CONTRAST] = jacobian[:, MIDDLE] * pattern
    jacobian[:, LIGHT_X] = seen * even * along_x
    jacobian[:, LIGHT_Y] = seen * even * along_y
    jacobian[:, HALO_STRENGTH] = lit * (one.halo * two.side + two.halo * one.side)
    return np.clip(light, *clipped)


def _blurred_step(beyond: Floats, falling: Floats) -> Floats:
    """erf(beyond / sqrt 2), to 2e-7 (Abramowitz and Stegun 7.1.26), by the exponential that is known already."""
    near = np.reciprocal(1 + _STEP_AT * np.abs(beyond))
    rest = near * (_STEP[0] + near * (_STEP[1] + near * (_STEP[2] + near * (_STEP[3] + near * _STEP[4]))))
    return np.asarray(np.copysign(1 - rest * falling, beyond))
