"""Measure the four corners of a tag, where the edges of its black square meet.

Nothing crosses at a tag's corner as it does on a checkerboard. So each edge is measured on its full
length, away from the corners, and neighbouring edges are intersected. An edge is a blurred step, an
error function of the distance from a curve, in light that changes along it. The fit determines the
curve's place and slope, the blur, and the light of both sides. The curve's bend is given by the
caller, who knows the camera: a straight line through an edge that bends by half a pixel is off by a
third of a pixel at its ends, and a fitted bend would make the corners less certain.

A tone curve that a camera applies moves all edges outwards or inwards, which looks like another
size of the tag: see ink_spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.corners.patch_fit import MAD_TO_SIGMA
from calib.corners.patch_noise import noise_inflation, split_chunks

Floats = NDArray[np.float64]

PASSES = 3  # the last one starts at its own result, so its linearisation is exact
MAX_ITERATIONS = 12
STEP_TOLERANCE = 1e-3  # px
MIN_WIDTH = 2.0  # px, on either side of an edge
MAX_WIDTH = 6.0
CLEARANCE = 0.5  # of a cell: the distance from an edge within which only that edge is visible
BLUR = 0.8  # px, the initial value
BLUR_LIMITS = np.log([0.3, 5.0])  # of px
END_MARGIN = 3.0  # blurs, from a corner: nearer to it the other edge shows
MIN_END_MARGIN = 2.0  # px
MAX_END_MARGIN = 0.25  # of the edge
OUTLIER_THRESHOLD = 3.0  # standard deviations of a pixel's noise, from which on its weight falls
MIN_CONTRAST = 10.0  # grey levels of 255, between white and black
MIN_NOISE = 0.29  # grey levels: that of rounding
PLACE, TILT, LOG_BLUR, DARK, WHITE, LIGHT = range(6)
# erf to 1.5e-7, formula 7.1.26 of M. Abramowitz and I. A. Stegun, Handbook of Mathematical
# Functions (1964): capture runs without scipy
ERF_ARGUMENT = 0.3275911
ERF_COEFFICIENTS = (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592, 0.0)
SIDES = 4


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The measured corners of T tags."""

    corners: Floats
    """(T, 4, 2) px, in the given order; NaN where the picture shows no black square."""
    covariances: Floats
    """(T, 8, 8) px^2 of x and y of the four corners, NaN where `corners` is NaN. Neighbouring
    corners are correlated: they share an edge.
    """
    blurs: Floats
    """(T, 4) px, the blur across the edge from each corner to the next; NaN where `corners` is
    NaN.
    """


def measure_outlines(
    grey: NDArray, rough: Floats, cells: int, bends: Floats | None = None
) -> Outlines:
    """Measure the corners of located tags.

    Args:
        grey: (H, W) uint8 or uint16.
        rough: (T, 4, 2) px, clockwise as seen in the picture, wrong by some pixels.
        cells: along a tag's side, with its black border.
        bends: (T, 4) px, how far the middle of the edge from each corner to the next lies outside
            the straight line; 0 by default.
    """
    bends = np.zeros(rough.shape[:2]) if bends is None else bends
    tags = [
        _measure_tag(grey, tag_corners, cells, tag_bends)
        for tag_corners, tag_bends in zip(rough, bends, strict=True)
    ]
    edges = [edge for tag in tags if tag for edge in tag.edges]
    inflation = _noise_inflation(edges) if edges else 1.0
    corners = np.full((len(rough), SIDES, 2), np.nan)
    covariances = np.full((len(rough), 2 * SIDES, 2 * SIDES), np.nan)
    blurs = np.full((len(rough), SIDES), np.nan)
    for index, tag in enumerate(tags):
        if tag:
            corners[index] = tag.corners
            blurs[index] = np.exp([edge.parameters[LOG_BLUR] for edge in tag.edges])
            covariances[index] = inflation * tag.unit_covariance()
    return Outlines(corners, covariances, blurs)


def edge_vectors(corners: Floats) -> tuple[Floats, Floats]:
    """Return the (..., 4, 2) vectors from each of (..., 4, 2) corners, clockwise as seen, to the
    next, and the unit normals of these edges, outward.
    """
    steps = np.roll(corners, -1, -2) - corners
    return steps, np.stack([steps[..., 1], -steps[..., 0]], -1) / np.linalg.norm(
        steps, axis=-1, keepdims=True
    )


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """One edge, fitted to P pixels, sorted along it."""

    parameters: Floats
    """(6,): the place in px, the tilt in px at the ends, the logarithm of the blur in px, two grey
    levels, and the relative change of the light from the middle to an end.
    """
    jacobian: Floats
    """(6, P)"""
    residuals: Floats
    """(P,) grey levels."""
    inverse: Floats
    """The (6, 6) inverse of the normal matrix."""
    half_width: float
    """px, on both sides of the edge."""


@dataclass(frozen=True, slots=True, eq=False)
class _Tag:
    """The edges of one tag and the corners where they meet."""

    corners: Floats
    """(4, 2) px"""
    normals: Floats
    """(4, 2) unit, outward, of the edge from each corner to the next."""
    edges: list[Edge]

    def unit_covariance(self) -> Floats:
        """Return (8, 8) px^2 for pixel noise of one grey level."""
        by_edge = np.zeros((2 * SIDES, 2 * SIDES))
        edge_covariance = np.zeros((2 * SIDES, 2 * SIDES))
        for index, edge in enumerate(self.edges):
            block = slice(2 * index, 2 * index + 2)
            previous = (index - 1) % SIDES
            # from the distances along both normals
            from_distances = np.linalg.inv(self.normals[[previous, index]])
            previous_block = slice(2 * previous, 2 * previous + 2)
            by_edge[block, previous_block] = from_distances[:, :1] @ [[1.0, 1.0]]
            by_edge[block, block] = from_distances[:, 1:] @ [[1.0, -1.0]]
            edge_covariance[block, block] = edge.inverse[:2, :2]
        return np.asarray(by_edge @ edge_covariance @ by_edge.T)


def _measure_tag(grey: NDArray, rough: Floats, cells: int, bends: Floats) -> _Tag | None:
    """Measure one tag from (4, 2) px corners and (4,) px bends; None where an edge is not
    visible.
    """
    corners, blurs = np.array(rough, np.float64), np.full(SIDES, BLUR)
    for _ in range(PASSES):
        steps, normals = edge_vectors(corners)
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
        # the shifts of the previous edge and of the own one, at each corner
        shifts = np.stack([np.roll(places.sum(1), 1), places[:, 0] - places[:, 1]], -1)
        both_normals = np.stack([np.roll(normals, 1, 0), normals], 1)
        corners = corners + np.linalg.solve(both_normals, shifts[..., None])[..., 0]
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
    """Fit the edge of black near the line from start to start + step; None where there is none.

    Args:
        grey: (H, W) uint8 or uint16.
        start: (2,) px.
        step: (2,) px.
        normal: (2,) unit, from black to white.
        bend: px, how far the middle of the edge lies outside the line.
        blur: px, the initial value.
        cell: px, of a tag's cell: within half a cell, nothing but the edge is visible.
    """
    length = float(np.linalg.norm(step))
    half_width = float(
        np.clip(3 * blur + 1, MIN_WIDTH, max(MIN_WIDTH, min(CLEARANCE * cell, MAX_WIDTH)))
    )
    margin = min(max(END_MARGIN * blur, MIN_END_MARGIN), MAX_END_MARGIN * length)
    end_points = np.stack([start, start + step])
    low = np.maximum(np.floor(end_points.min(0) - half_width - abs(bend)).astype(int), 0)
    high = np.minimum(
        np.ceil(end_points.max(0) + half_width + abs(bend)).astype(int) + 1, grey.shape[::-1]
    )
    if (high <= low).any():
        return None
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    offset = np.stack([x.ravel(), y.ravel()], -1) - start
    axial = offset @ step / length**2 * 2 - 1  # -1 to 1
    distance = offset @ normal - bend * (1 - axial**2)
    used = np.flatnonzero(
        (np.abs(distance) <= half_width) & (np.abs(axial) <= 1 - 2 * margin / length)
    )
    used = used[np.argsort(axial[used], kind="stable")]
    if len(used) < 2 * len(range(6)):
        return None
    light = grey[low[1] : high[1], low[0] : high[0]].ravel()[used] / (
        257.0 if grey.dtype == np.uint16 else 1.0
    )
    return _fit_pixels(light, axial[used], distance[used], blur, half_width)


def _fit_pixels(
    light: Floats, axial: Floats, distance: Floats, blur: float, half_width: float
) -> Edge | None:
    """Fit an edge to (P,) pixels by Levenberg-Marquardt steps; None where there is none.

    Args:
        light: grey levels.
        axial: position along the edge, -1 to 1.
        distance: px from the line, positive on the white side.
        blur: px, the initial value.
        half_width: px.
    """
    bright_side = distance > 0
    if not (bright_side.any() and (~bright_side).any()):
        return None
    parameters = np.array(
        [
            0.0,
            0.0,
            np.log(blur),
            np.quantile(light[~bright_side], 0.3),
            np.quantile(light[bright_side], 0.7),
            0.0,
        ]
    )
    damping = 1e-3
    residuals, jacobian = _residuals(parameters, light, axial, distance)
    for _ in range(MAX_ITERATIONS):
        threshold = _outlier_threshold(residuals)
        weight = np.minimum(1.0, threshold / np.maximum(np.abs(residuals), 1e-9))
        normal = (jacobian * weight) @ jacobian.T
        step = np.linalg.solve(
            normal + damping * np.diag(normal.diagonal() + 1e-9), jacobian @ (weight * residuals)
        )
        candidate = parameters + step
        candidate[LOG_BLUR] = np.clip(candidate[LOG_BLUR], *BLUR_LIMITS)
        new_residuals, new_jacobian = _residuals(candidate, light, axial, distance)
        better = _cost(new_residuals, threshold) <= _cost(residuals, threshold) * (1 + 1e-9)
        if better:
            parameters, residuals, jacobian = candidate, new_residuals, new_jacobian
        damping = damping / 10 if better else damping * 10
        if np.abs(step[:2]).max() < STEP_TOLERANCE:
            break
    has_contrast = parameters[WHITE] - parameters[DARK] >= MIN_CONTRAST
    if not (has_contrast and np.abs(parameters[:2]).max() <= half_width):
        return None
    threshold = _outlier_threshold(residuals)
    weight = np.minimum(1.0, threshold / np.maximum(np.abs(residuals), 1e-9))
    inverse = np.linalg.inv((jacobian * weight) @ jacobian.T + 1e-9 * np.eye(len(parameters)))
    return Edge(
        parameters,
        jacobian,
        np.asarray(weight * residuals),
        np.asarray(inverse, np.float64),
        half_width,
    )


def _outlier_threshold(residuals: Floats) -> float:
    """Return the size of residual, grey levels, above which a pixel's weight falls."""
    noise = MAD_TO_SIGMA * float(np.median(np.abs(residuals)))
    return OUTLIER_THRESHOLD * max(noise, MIN_NOISE)


def _residuals(
    parameters: Floats, light: Floats, axial: Floats, distance: Floats
) -> tuple[Floats, Floats]:
    """Return the (P,) residuals, observed minus predicted, grey levels, and the (6, P) derivatives
    of the prediction.
    """
    blur = np.exp(parameters[LOG_BLUR])
    blurs_away = (distance - parameters[PLACE] - parameters[TILT] * axial) / blur
    side = (1 + _erf(blurs_away / 2**0.5)) / 2
    contrast = parameters[WHITE] - parameters[DARK]
    light_factor = 1 + parameters[LIGHT] * axial
    even_light = parameters[DARK] + contrast * side
    slope = (
        light_factor * contrast * np.exp(-(blurs_away**2) / 2) / (2 * np.pi) ** 0.5
    )  # by `blurs_away`
    jacobian = np.stack(
        [
            -slope / blur,
            -slope * axial / blur,
            -slope * blurs_away,
            light_factor * (1 - side),
            light_factor * side,
            even_light * axial,
        ]
    )
    return light - light_factor * even_light, jacobian


def _erf(x: Floats) -> Floats:
    """Return the error function."""
    t = 1 / (1 + ERF_ARGUMENT * np.abs(x))
    return np.asarray(np.sign(x) * (1 - np.polyval(ERF_COEFFICIENTS, t) * np.exp(-(x**2))))


def _cost(residuals: Floats, threshold: float) -> float:
    """Return Huber's cost."""
    size = np.abs(residuals) / threshold
    return float(np.where(size < 1, size**2, 2 * size - 1).sum())


def _noise_inflation(edges: list[Edge]) -> float:
    """Return the factor for the unit covariances from the picture's own noise, grey levels^2."""
    width = max(1, round(float(np.median([edge.half_width for edge in edges])))) * 2 + 1
    places = -(-max(edge.residuals.size for edge in edges) // width)
    chunks = [slice(chunk.start * width, chunk.stop * width) for chunk in split_chunks(places)]
    rows = [np.vstack([edge.jacobian, edge.residuals]).astype(np.float32) for edge in edges]
    sums = np.array(
        [[matrix[:-1, chunk] @ matrix[:, chunk].T for matrix in rows] for chunk in chunks]
    )
    inverses = np.array([edge.inverse for edge in edges])
    inflation = noise_inflation(sums[..., :-1], sums[..., -1], inverses)
    # a picture without any noise is rounded, too
    return inflation if inflation > MIN_NOISE**2 else MIN_NOISE**2
