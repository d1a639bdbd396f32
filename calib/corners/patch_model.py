"""The model of a patch around a corner: its light, and the derivatives by each of its parameters.

Two edges meet at the corner, each with the curvature of its neighbours. The light is an error
function of the distance from an edge: a step, blurred by the lens and by the pixel's own square,
whose standard deviation across an edge is 12^-1/2 px in any direction. The product of both edges is
the checkerboard. Where the edges are not perpendicular, a blurred corner differs from the product
by the correlation of the two distances, and the model keeps its first three orders. Uneven light
multiplies all of it. Farther from the crossing edge than its blur and halo reach, that edge
contributes only a sign.

Sharpening, a tone curve, and the rounder foot of a real blur are not in the model. All of them
leave a corner's picture unchanged when it is turned by 180 degrees, like the model. So they can
inflate the residuals, but they cannot move the fitted place.
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
"""px from the lattice's corner, rad, logarithms of px, grey levels, and the relative change of the
light over half a patch.
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
PLACE = slice(X, X + 2)
ANGLES = slice(FIRST_ANGLE, FIRST_ANGLE + 2)
BLURS = slice(FIRST_BLUR, FIRST_BLUR + 2)
LIGHTS = slice(FIRST_LIGHT, FIRST_LIGHT + 2)
# Derivatives have the px across both edges in place of x and y:
FIRST_ACROSS = X
SECOND_ACROSS = Y
# the second edge's parameters before the first one's
SECOND_FIRST = [1, 0, 3, 2, 5, 4, 6, 7, 9, 8, 10]

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]

HALO = 1.2  # px from an edge, where sharpening's overshoot is largest
# Farther from an edge, it contributes only a sign, with an error of 1e-5 of the step and 7e-4 of
# the halo.
STEP_REACH = 4.5  # blurs
HALO_REACH = 5.0  # px
_PEAK = (2 / math.pi) ** 0.5
# tanh of an odd polynomial with these coefficients is erf(x / sqrt 2), to 3e-4: a pixel's rounding
# is ten times that
_STEP = (0.7987782, 0.035297989)
_ROWS, _COLUMNS = np.triu_indices(3)
_HALF = np.where(_ROWS == _COLUMNS, 0.5, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """One edge of each row, evaluated at P pixels."""

    back: Floats
    """(R, P) px along the edge, towards the corner."""
    distance: Floats
    """(R, P) blurs, across the edge."""
    side: Floats
    """(R, P) the blurred step from -1 to 1, with the halo added."""
    slope: Floats
    """(R, P) the slope of the blurred step, over its peak."""
    halo: Floats
    """(R, P) what sharpening adds to the step, for a strength of 1."""
    halo_slope: Floats
    """(R, P) the slope of the halo, over its peak."""
    sharpness: Floats
    """(R, 1) 1/px, the peak slope of the step."""
    halo_sharpness: Floats
    """(R, 1) 1/px, the peak slope of the halo."""

    @staticmethod
    def evaluate(
        distance: Floats, halo_distance: Floats, back: Floats, blur: Floats, strength: Floats
    ) -> "_Edge":
        """Evaluate the edge.

        Args:
            distance: (R, P) blurs across the edge.
            halo_distance: (R, P), the same distance in units of HALO. It is overwritten.
            back: (R, P) px along the edge, towards the corner.
            blur: (R, 1) px.
            strength: (R, 1), the halo's.
        """
        squared = distance * distance
        side = squared * _STEP[1]
        side += _STEP[0]
        side *= distance
        np.tanh(side, out=side)
        squared *= -0.5
        slope = np.exp(squared, out=squared)
        halo_slope = halo_distance * halo_distance
        halo_slope *= -0.5
        np.exp(halo_slope, out=halo_slope)
        halo = halo_distance * halo_slope
        side += halo * strength
        halo_distance *= halo
        halo_slope -= halo_distance
        return _Edge(back, distance, side, slope, halo, halo_slope, _PEAK / blur, strength / HALO)

    def select(self, rows: slice = slice(None), pixels: slice = slice(None)) -> "_Edge":
        """Return the edge in these rows, at these pixels."""
        return _Edge(
            back=self.back[rows, pixels],
            distance=self.distance[rows, pixels],
            side=self.side[rows, pixels],
            slope=self.slope[rows, pixels],
            halo=self.halo[rows, pixels],
            halo_slope=self.halo_slope[rows, pixels],
            sharpness=self.sharpness[rows],
            halo_sharpness=self.halo_sharpness[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedPatches:
    """The light that the model predicts for the pixels of R rows of patches, with intermediate
    results.
    """

    light: Floats
    """(R, P) grey levels."""
    own_edge: _Edge
    crossing_edge: _Edge
    """At the first pixels only, which are near it."""
    facing: Floats
    """(R, P) from -1 to 1, the side of the crossing edge."""
    correlation: Floats
    """(R, near), the first order of the difference between a blurred corner and the product of its
    edges.
    """
    pattern: Floats
    """(R, P) from -1 to 1."""
    even_light: Floats
    """(R, P) grey levels of the patch in even light."""
    light_factor: Floats
    """(R, P) the relative light, 1 in the middle."""
    contrast: Floats
    """(R, 1) grey levels."""
    crossing: Floats
    """(R, 1) the sine of the angle from the own edge to the crossing one."""
    u: Floats
    """(R, P) parts of a patch along the own edge."""
    v: Floats
    """(R, P) parts of a patch along the crossing edge."""

    @staticmethod
    def predict(parameters: Doubles, patches: Patches, curvatures: Doubles) -> "ExpectedPatches":
        """Predict the light.

        Args:
            parameters: (R, 11), as in `PARAMETERS`, but the own edge's before the crossing one's.
            patches: R rows.
            curvatures: (R, 2) 1/px, of the own edge and the crossing one.
        """
        angles, blurs = parameters[:, ANGLES], np.exp(parameters[:, BLURS])
        distance, back = _edge_forms(parameters[:, PLACE], angles, curvatures, patches.ends)
        forms = np.zeros((2, len(parameters), 4, 6), np.float32)  # of the own and the crossing edge
        forms[:, :, 0] = (distance / blurs[..., None]).swapaxes(0, 1)
        forms[:, :, 1] = (distance / HALO).swapaxes(0, 1)
        forms[:, :, 2] = back.swapaxes(0, 1)
        forms[0, :, 3, 0], forms[0, :, 3, 1:3] = 1, parameters[:, LIGHTS]
        middle = _column(parameters[:, MIDDLE])
        contrast = _column(parameters[:, CONTRAST])
        strength = _column(parameters[:, HALO_STRENGTH])
        own_distance, own_ring, own_back, light_factor = _evaluate_forms(forms[0], patches.forms)
        own_edge = _Edge.evaluate(own_distance, own_ring, own_back, _column(blurs[:, 0]), strength)
        reach = max(STEP_REACH * float(blurs[:, 1].max()), HALO_REACH)
        near = int(np.searchsorted(patches.crossing_distance, reach))
        crossing_distance, crossing_ring, crossing_back = _evaluate_forms(
            forms[1, :, :3], patches.forms[..., :near]
        )
        crossing_edge = _Edge.evaluate(
            crossing_distance, crossing_ring, crossing_back, _column(blurs[:, 1]), strength
        )

        facing = patches.facing.copy()
        facing[:, :near] = crossing_edge.side
        pattern = own_edge.side * facing
        turn = angles[:, 1] - angles[:, 0]
        slant = _column(np.cos(turn))
        correlation = own_edge.slope[:, :near] * crossing_edge.slope
        correlation *= _PEAK**2 * slant
        higher_orders = own_edge.distance[:, :near] * crossing_edge.distance
        higher_orders *= slant / 2  # orders of the slant
        higher_orders += 1 + (own_edge.distance[:, :near] ** 2 - 1) * (
            crossing_edge.distance**2 - 1
        ) * (slant**2 / 6)
        higher_orders *= correlation
        pattern[:, :near] += higher_orders
        even_light = pattern * contrast
        even_light += middle
        return ExpectedPatches(
            light=even_light * light_factor,
            own_edge=own_edge,
            crossing_edge=crossing_edge,
            facing=facing,
            correlation=correlation,
            pattern=pattern,
            even_light=even_light,
            light_factor=light_factor,
            contrast=contrast,
            crossing=_column(np.sin(turn)),
            u=patches.forms[1],
            v=patches.forms[2],
        )

    def select(self, rows: slice) -> "ExpectedPatches":
        """Return the prediction for these rows."""
        return ExpectedPatches(
            light=self.light[rows],
            own_edge=self.own_edge.select(rows),
            crossing_edge=self.crossing_edge.select(rows),
            facing=self.facing[rows],
            correlation=self.correlation[rows],
            pattern=self.pattern[rows],
            even_light=self.even_light[rows],
            light_factor=self.light_factor[rows],
            contrast=self.contrast[rows],
            crossing=self.crossing[rows],
            u=self.u[rows],
            v=self.v[rows],
        )

    def derivatives(self, weights: Floats, out: Sequence[Floats]) -> None:
        """Write the derivatives of the light, times (R, P) weights, into eleven (R, P) arrays.

        They are by the parameters, the own edge's before the crossing one's. In place of x and y
        they are by the px across both edges.
        """
        own_edge = self.own_edge
        crossing_edge = self.crossing_edge
        near = crossing_edge.side.shape[1]
        np.multiply(weights, self.light_factor, out=out[MIDDLE])
        np.multiply(out[MIDDLE], self.pattern, out=out[CONTRAST])
        lit = weights * self.even_light
        np.multiply(lit, self.u, out=out[FIRST_LIGHT])
        np.multiply(lit, self.v, out=out[SECOND_LIGHT])
        np.multiply(out[MIDDLE], self.contrast, out=lit)
        facing = lit * self.facing
        np.multiply(facing, own_edge.halo, out=out[HALO_STRENGTH])
        step = facing * own_edge.slope
        np.multiply(step, own_edge.distance, out=out[FIRST_BLUR])
        out[FIRST_BLUR] *= -_PEAK
        np.multiply(step, own_edge.sharpness, out=out[FIRST_ACROSS])
        facing *= own_edge.halo_slope
        facing *= own_edge.halo_sharpness
        out[FIRST_ACROSS] += facing
        for index in (SECOND_ACROSS, SECOND_ANGLE, SECOND_BLUR):
            out[index][:, near:] = 0
        self._add_near_derivatives(
            lit[:, :near],
            own_edge.select(pixels=slice(near)),
            [derivative[:, :near] for derivative in out],
        )
        np.multiply(out[FIRST_ACROSS], own_edge.back, out=out[FIRST_ANGLE])
        closing = lit[:, :near] * own_edge.slope[:, :near]
        closing *= crossing_edge.slope
        closing *= _PEAK**2 * self.crossing  # of the angle between them
        out[FIRST_ANGLE][:, :near] += closing
        np.multiply(
            out[SECOND_ACROSS][:, :near], crossing_edge.back, out=out[SECOND_ANGLE][:, :near]
        )
        out[SECOND_ANGLE][:, :near] -= closing

    def _add_near_derivatives(self, lit: Floats, own_edge: _Edge, out: Sequence[Floats]) -> None:
        """Add the derivatives at the pixels near both edges: the crossing edge's own, and those of
        the correlation, to the first order of the slant.
        """
        crossing_edge = self.crossing_edge
        correlation = lit * self.correlation
        curved = correlation * own_edge.distance
        out[FIRST_ACROSS] -= curved * (own_edge.sharpness / _PEAK)
        curved *= own_edge.distance
        out[FIRST_BLUR] += curved
        lit = lit * own_edge.side
        out[HALO_STRENGTH] += lit * crossing_edge.halo
        step = lit * crossing_edge.slope
        step *= _PEAK
        correlation *= crossing_edge.distance
        step -= correlation
        np.multiply(step, -crossing_edge.distance, out=out[SECOND_BLUR])
        np.multiply(step, crossing_edge.sharpness / _PEAK, out=out[SECOND_ACROSS])
        lit *= crossing_edge.halo_slope
        lit *= crossing_edge.halo_sharpness
        out[SECOND_ACROSS] += lit


def place_per_distance(parameters: Doubles) -> Doubles:
    """Return (N, 2, 2), the px in x and y by which the corner moves for each px that its pixels
    move across the first edge, and across the second.
    """
    first, second = parameters[:, ANGLES].T
    rows = (
        np.stack([-np.cos(second), np.cos(first), -np.sin(second), np.sin(first)], -1)
        / np.sin(second - first)[:, None]
    )
    return np.asarray(rows.reshape(-1, 2, 2))


def _evaluate_forms(forms: Floats, monomials: Floats) -> Floats:
    """Return the (k, R, P) values of (R, k, 6) polynomials in the (6, R, P) monomials."""
    values = np.empty((forms.shape[1], *monomials.shape[1:]), np.float32)
    np.matmul(forms, monomials.swapaxes(0, 1), out=values.swapaxes(0, 1))
    return values


def _edge_forms(
    place: Doubles, angles: Doubles, curvatures: Doubles, ends: Doubles
) -> tuple[Doubles, Doubles]:
    """Return the px across each edge, and the px along it towards the corner, as (R, 2 edges, 6)
    polynomials.
    """
    cosine, sine = np.cos(angles), np.sin(angles)
    towards = np.stack([-place, ends[:, 0], ends[:, 1]], -1)  # (R, 2, 3) px for 1, u, v
    axial = np.stack([cosine, sine], -1) @ towards
    distance, back = np.zeros((*angles.shape, 6)), np.zeros((*angles.shape, 6))
    back[..., :3], distance[..., :3] = -axial, np.stack([-sine, cosine], -1) @ towards
    distance -= (axial[..., _ROWS] * axial[..., _COLUMNS]) * (curvatures[..., None] * _HALF)
    return distance, back


def _column(values: Doubles) -> Floats:
    """Return (R,) values as an (R, 1) column."""
    return values.astype(np.float32)[:, None]
