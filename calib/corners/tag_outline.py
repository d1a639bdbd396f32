"""The four corners of a tag, where the edges of its black square meet.

Nothing crosses in a tag's corner as in a checkerboard's, so each edge is measured on its whole
length, away from the corners, and neighbours are intersected. An edge is a blurred step, an error
function of the distance from a curve, in light that changes along it: what is fitted is the curve's
place and slope, the blur, and the light of both sides. The curve's bend is given, by who knows the
camera: a straight line through an edge that bends by half a pixel has its ends off by a third, and
to fit the bend too makes corners less sure.

A curve of tones that a camera applies moves all edges outwards or inwards, which is the same as
another size of the tag: see tag_growth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from calib.corners.patch_fit import SIGMA
from calib.corners.patch_noise import chunks, inflation

Floats = NDArray[np.float64]

PASSES = 3  # the last begins where it ends, so that what is linearised there is exact
STEPS = 12  # at most, of a fit's
SETTLED = 1e-3  # px
WIDTHS = (2.0, 6.0)  # px, to either side of an edge, the limits
WITHIN = 0.5  # of a cell: beside an edge, so much shows nothing but that edge
BLUR = 0.8  # px, to start with
BLUR_LIMITS = np.log([0.3, 5.0])  # of px
ENDS = 3.0  # blurs, from a corner: nearer the other edge shows
LEAST_ENDS, MOST_ENDS = 2.0, 0.25  # px, and of the edge
OUTLYING = 3.0  # standard deviations of a pixel's noise, from which on it weighs less
FAINTEST = 10.0  # grey levels of 255, between white and black
NOISE = 0.29  # grey levels: rounding's own
PLACE, TILT, LOG_BLUR, DARK, WHITE, LIGHT = range(6)
SIDES = 4


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """T tags."""

    corners: Floats
    """(T, 4, 2) px, in the order in which they were given; NaN where the picture shows no black
    square there.
    """
    covariances: Floats
    """(T, 8, 8) px^2 of x and y of the four corners, NaN likewise; neighbours share an edge."""


def measure_outlines(
    grey: NDArray, rough: Floats, cells: int, bends: Floats | None = None
) -> Outlines:
    """Measure the corners of tags that were found.

    Args:
        grey: (H, W) uint8 or uint16.
        rough: (T, 4, 2) px, clockwise as seen in the picture, off by some pixels.
        cells: along a tag's side, its black border among them.
        bends: (T, 4) px, by how much the middle of the edge from each corner to the next lies
            outside of the straight line; 0 by default.
    """
    bends = np.zeros(rough.shape[:2]) if bends is None else bends
    found = [_tag(grey, own, cells, bent) for own, bent in zip(rough, bends, strict=True)]
    edges = [edge for tag in found if tag for edge in tag.edges]
    grown = _inflation(edges) if edges else 1.0
    corners, covariances = (
        np.full((len(rough), SIDES, 2), np.nan),
        np.full((len(rough), 2 * SIDES, 2 * SIDES), np.nan),
    )
    for at, tag in enumerate(found):
        if tag:
            corners[at], covariances[at] = tag.corners, grown * tag.unit_covariance()
    return Outlines(corners, covariances)


def edges_of(corners: Floats) -> tuple[Floats, Floats]:
    """(..., 4, 2) from each of (..., 4, 2) corners, clockwise as seen, to the next, and the unit
    normals of these edges, outward.
    """
    steps = np.roll(corners, -1, -2) - corners
    return steps, np.stack([steps[..., 1], -steps[..., 0]], -1) / np.linalg.norm(
        steps, axis=-1, keepdims=True
    )


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """One edge, fitted to P pixels, sorted along it."""

    parameters: Floats
    """(6,) px, px at the ends, log px, and grey levels; the light as a part of itself from the
    middle to an end.
    """
    jacobian: Floats
    """(6, P)"""
    residuals: Floats
    """(P,) grey levels."""
    inverse: Floats
    """(6, 6) of the normal matrix."""
    half_width: float


@dataclass(frozen=True, slots=True, eq=False)
class _Tag:
    corners: Floats
    """(4, 2) px"""
    normals: Floats
    """(4, 2) unit, outward, of the edge from each corner to the next."""
    edges: list[Edge]

    def unit_covariance(self) -> Floats:
        """(8, 8) px^2 for pixels' noise of one grey level."""
        by_edge, spread = np.zeros((2 * SIDES, 2 * SIDES)), np.zeros((2 * SIDES, 2 * SIDES))
        for at, edge in enumerate(self.edges):
            own = slice(2 * at, 2 * at + 2)
            before = (at - 1) % SIDES
            turned = np.linalg.inv(
                self.normals[[before, at]]
            )  # from the distances along both normals
            by_edge[own, 2 * before : 2 * before + 2] = turned[:, :1] @ [[1.0, 1.0]]
            by_edge[own, own] = turned[:, 1:] @ [[1.0, -1.0]]
            spread[own, own] = edge.inverse[:2, :2]
        return np.asarray(by_edge @ spread @ by_edge.T)


def _tag(grey: NDArray, rough: Floats, cells: int, bends: Floats) -> _Tag | None:
    corners, blurs = np.array(rough, np.float64), np.full(SIDES, BLUR)
    for _ in range(PASSES):
        steps, normals = edges_of(corners)
        cell = float(np.linalg.norm(steps, axis=-1).min()) / cells
        edges = []
        for start, step, normal, bend, blur in zip(
            corners, steps, normals, bends, blurs, strict=True
        ):
            edge = fit_edge(grey, start, step, normal, float(bend), float(blur), cell)
            if edge is None:
                return None
            edges.append(edge)
        places = np.array([edge.parameters[:2] for edge in edges])
        beyond = np.stack(
            [np.roll(places.sum(1), 1), places[:, 0] - places[:, 1]], -1
        )  # of the edge before, and of the own, at a corner
        corners = (
            corners
            + np.linalg.solve(np.stack([np.roll(normals, 1, 0), normals], 1), beyond[..., None])[
                ..., 0
            ]
        )
        blurs = np.exp(np.array([edge.parameters[LOG_BLUR] for edge in edges]))
    return _Tag(corners, normals, edges)


def fit_edge(
    grey: NDArray,
    start: Floats,
    step: Floats,
    normal: Floats,
    bend: float,
    blur: float,
    cell: float,
) -> Edge | None:
    """The edge of black near a line from start to start + step, (2,) px each, beyond which, along
    the (2,) normal, white begins; None where there is none. It bends outwards by so many px; blur
    is a guess, and within half a cell, px, nothing else is seen.
    """
    length = float(np.linalg.norm(step))
    half_width = float(
        np.clip(3 * blur + 1, WIDTHS[0], max(WIDTHS[0], min(WITHIN * cell, WIDTHS[1])))
    )
    ends = min(max(ENDS * blur, LEAST_ENDS), MOST_ENDS * length)
    ends_of = np.stack([start, start + step])
    low = np.maximum(np.floor(ends_of.min(0) - half_width - abs(bend)).astype(int), 0)
    high = np.minimum(
        np.ceil(ends_of.max(0) + half_width + abs(bend)).astype(int) + 1, grey.shape[::-1]
    )
    if (high <= low).any():
        return None
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    apart = np.stack([x.ravel(), y.ravel()], -1) - start
    along = apart @ step / length**2 * 2 - 1  # -1 to 1
    across = apart @ normal - bend * (1 - along**2)
    used = np.flatnonzero((np.abs(across) <= half_width) & (np.abs(along) <= 1 - 2 * ends / length))
    used = used[np.argsort(along[used], kind="stable")]
    if len(used) < 2 * len(range(6)):
        return None
    light = grey[low[1] : high[1], low[0] : high[0]].ravel()[used] / (
        257.0 if grey.dtype == np.uint16 else 1.0
    )
    return _fit(light, along[used], across[used], blur, half_width)


def _fit(
    light: Floats, along: Floats, across: Floats, blur: float, half_width: float
) -> Edge | None:
    """Levenberg's and Marquardt's steps."""
    outside = across > 0
    if not (outside.any() and (~outside).any()):
        return None
    own = np.array(
        [
            0.0,
            0.0,
            np.log(blur),
            np.quantile(light[~outside], 0.3),
            np.quantile(light[outside], 0.7),
            0.0,
        ]
    )
    damping = 1e-3
    residuals, jacobian = _residuals(own, light, along, across)
    for _ in range(STEPS):
        bound = OUTLYING * max(SIGMA * float(np.median(np.abs(residuals))), NOISE)
        weight = np.minimum(1.0, bound / np.maximum(np.abs(residuals), 1e-9))
        normal = (jacobian * weight) @ jacobian.T
        step = np.linalg.solve(
            normal + damping * np.diag(normal.diagonal() + 1e-9), jacobian @ (weight * residuals)
        )
        tried = own + step
        tried[LOG_BLUR] = np.clip(tried[LOG_BLUR], *BLUR_LIMITS)
        new_residuals, new_jacobian = _residuals(tried, light, along, across)
        better = _cost(new_residuals, bound) <= _cost(residuals, bound) * (1 + 1e-9)
        if better:
            own, residuals, jacobian = tried, new_residuals, new_jacobian
        damping = damping / 10 if better else damping * 10
        if np.abs(step[:2]).max() < SETTLED:
            break
    if not (own[WHITE] - own[DARK] >= FAINTEST and np.abs(own[:2]).max() <= half_width):
        return None
    bound = OUTLYING * max(SIGMA * float(np.median(np.abs(residuals))), NOISE)
    weight = np.minimum(1.0, bound / np.maximum(np.abs(residuals), 1e-9))
    inverse = np.linalg.inv((jacobian * weight) @ jacobian.T + 1e-9 * np.eye(len(own)))
    return Edge(
        own, jacobian, np.asarray(weight * residuals), np.asarray(inverse, np.float64), half_width
    )


def _residuals(own: Floats, light: Floats, along: Floats, across: Floats) -> tuple[Floats, Floats]:
    """(P,) grey levels, seen less predicted, and (6, P) the derivatives of what is predicted."""
    blur = np.exp(own[LOG_BLUR])
    beyond = (across - own[PLACE] - own[TILT] * along) / blur
    side = (1 + erf(beyond / 2**0.5)) / 2
    contrast, uneven = own[WHITE] - own[DARK], 1 + own[LIGHT] * along
    even = own[DARK] + contrast * side
    steep = uneven * contrast * np.exp(-(beyond**2) / 2) / (2 * np.pi) ** 0.5  # by `beyond`
    jacobian = np.stack(
        [
            -steep / blur,
            -steep * along / blur,
            -steep * beyond,
            uneven * (1 - side),
            uneven * side,
            even * along,
        ]
    )
    return light - uneven * even, jacobian


def _cost(residuals: Floats, bound: float) -> float:
    """Huber's."""
    size = np.abs(residuals) / bound
    return float(np.where(size < 1, size**2, 2 * size - 1).sum())


def _inflation(edges: list[Edge]) -> float:
    """Grey levels^2: what the picture's own noise makes of the unit covariances."""
    width = max(1, round(float(np.median([edge.half_width for edge in edges])))) * 2 + 1
    places = -(-max(edge.residuals.size for edge in edges) // width)
    parts = [slice(part.start * width, part.stop * width) for part in chunks(places)]
    rows = [np.vstack([edge.jacobian, edge.residuals]).astype(np.float32) for edge in edges]
    sums = np.array([[own[:-1, part] @ own[:, part].T for own in rows] for part in parts])
    grown = inflation(sums[..., :-1], sums[..., -1], np.array([edge.inverse for edge in edges]))
    return grown if grown > NOISE**2 else NOISE**2  # a picture without any noise, too, is rounded
