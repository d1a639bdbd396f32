"""The blur and the exposure of a picture, measured on a board with markers.

The method is that of `capture.sharpness`, with one difference: the white of a ChArUco's square is a
narrow rim, and a marker begins behind it. So the profile across an edge is compared with the
profile of a blurred rim of known width, for a series of blurs. This gives black and white as they
were before the blur. Corners with black to one side and corners with black to the other take turns
along a row, so the marker's effect on the light of one kind cancels that on the other.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice, edge_normals
from calib.session.board import Board
from calib.session.coding import Charuco
from capture.exposure import FULL, VIDEO_FULL, SquareLighting
from capture.sharpness import (
    MAX_REACH,
    REACH_FRACTION,
    WEIGHT,
    Blur,
    blur_of,
    light_at,
    sample_grey,
)

Floats = NDArray[np.float64]

SIDE_POSITIONS = np.linspace(
    0.2, 0.45, 6
)  # fraction of the step to the next corner: clear of the other edge, and before this one ends
PROFILE_OFFSETS = np.linspace(-1, 1, 33)  # positions on a profile, in units of its reach
BLUR_SIGMAS = np.geomspace(0.35, 5.0, 20)  # px, the candidate blurs
# fraction of the free distance beside an edge, over which its colour is measured
COLOUR_RANGE = (0.4, 1.0)
CONTRAST_PERCENTILE = 25  # percentile of the corners' contrast: a hand may cover some of them
MAX_CORNERS = 48  # corners, drawn at random: more do not improve the result
MIN_CORNERS = 4  # corners of either kind, or edges in either direction


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    blur: Blur | None
    """None: the board has no measurable edges."""
    exposure: SquareLighting


def measure_light(grey: NDArray[np.uint8], corners: Floats, board: Board) -> Light:
    """Return the blur and the exposure around the (count, 2) px corners of a (H, W) picture; NaN
    where a corner is not visible.
    """
    lattice = _sample_corners(Lattice.from_corners(corners, board))
    rim = (
        (1 - board.coding.marker / board.square) / 2
        if isinstance(board.coding, Charuco)
        else np.inf
    )
    reach = np.minimum(
        (REACH_FRACTION if np.isfinite(rim) else lattice.clearance) * lattice.heights, MAX_REACH
    )  # (N, edge) px, to either side
    across_step = (
        lattice.steps[:, ::-1] * (reach / lattice.heights)[..., None]
    )  # (N, edge, 2) px: along the other edge
    along_step = (
        np.concatenate([-SIDE_POSITIONS[::-1], SIDE_POSITIONS])[:, None] * lattice.steps[:, :, None]
    )  # (N, edge, along, 2)
    positions = (
        lattice.corners[:, None, None, None]
        + along_step[..., None, :]
        + PROFILE_OFFSETS[:, None] * across_step[:, :, None, None]
    )
    light = sample_grey(grey, positions).reshape(
        len(positions), 2, 2, len(SIDE_POSITIONS), len(PROFILE_OFFSETS)
    )  # by corner, edge, and side of the corner along it
    edge_distance = (
        np.abs(PROFILE_OFFSETS) * (reach / (lattice.clearance * lattice.heights))[..., None]
    )  # (N, edge, PROFILE_OFFSETS)
    near_edge = ((edge_distance > COLOUR_RANGE[0]) & (edge_distance < COLOUR_RANGE[1]))[
        :, :, None, None
    ]
    white_excess = (light * (near_edge & (PROFILE_OFFSETS > 0))).sum((-1, -2)) - (
        light * (near_edge & (PROFILE_OFFSETS < 0))
    ).sum((-1, -2))  # (N, edge, side)
    starts_white = (white_excess * [-1, 1]).sum(
        (1, 2)
    ) > 0  # (N,) whether the square ahead along both edges is the lighter one
    white_behind = starts_white[:, None, None] == np.array([False, True])  # (N, 1, side)
    profiles = light.mean(3)
    profiles = np.where(white_behind[..., None], profiles, profiles[..., ::-1])
    fits = [
        _Edges.of(profiles[:, edge], reach[:, edge], rim * lattice.heights[:, edge])
        for edge in (0, 1)
    ]
    white = light[
        np.broadcast_to(white_behind[..., None, None] == (PROFILE_OFFSETS > 0), light.shape)
        & near_edge
    ]
    brightest = light.max()
    clipped = (
        float((white >= min(brightest, FULL)).mean())
        if brightest >= VIDEO_FULL and white.size
        else 0.0
    )
    contrast = float(
        np.percentile(np.concatenate([fit.white - fit.black for fit in fits]), CONTRAST_PERCENTILE)
    )
    return Light(_blur(grey, lattice, fits, starts_white), SquareLighting(clipped, contrast))


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """The edges at N corners in one direction, averaged over both sides of the corner."""

    sigma: float
    """px, the blur across the edges."""
    black: Floats
    """(N,) grey levels, before the blur."""
    white: Floats

    @staticmethod
    def of(profiles: Floats, reach: Floats, rim: Floats) -> "_Edges":
        """Fit (N, 2, PROFILE_OFFSETS) grey levels over (N,) px to either side, with white behind
        the edge for (N,) px.
        """
        position = PROFILE_OFFSETS * reach[:, None]  # (N, PROFILE_OFFSETS) px
        weight = (position <= rim[:, None]).astype(np.float64)
        white_share = np.array(
            [
                _normal_cdf(position / s) - _normal_cdf((position - rim[:, None]) / s)
                for s in BLUR_SIGMAS
            ]
        )  # (S, N, PROFILE_OFFSETS) white's share
        profile = profiles.mean(1)
        total = weight.sum(1)
        mean_share = (white_share * weight).sum(-1) / total  # (S, N)
        mean_level = (profile * weight).sum(-1) / total  # (N,)
        share = (white_share - mean_share[..., None]) * weight
        level = profile - mean_level[:, None]
        gain = (share * level).sum(-1) / np.maximum((share**2).sum(-1), 1e-9)  # (S, N)
        fitted = gain[..., None] * (white_share - mean_share[..., None])
        misfit = (weight * (level - fitted) ** 2).sum(-1)
        best = misfit.argmin(0)
        rows = np.arange(len(position))
        black = mean_level - (gain * mean_share)[best, rows]
        return _Edges(
            float(np.median(_interpolate_sigma(misfit, best))), black, black + gain[best, rows]
        )


def _sample_corners(lattice: Lattice) -> Lattice:
    sample = np.random.default_rng(0).permutation(len(lattice.corners))[:MAX_CORNERS]
    return replace(
        lattice,
        corners=lattice.corners[sample],
        steps=lattice.steps[sample],
        curvatures=lattice.curvatures[sample],
    )


def _interpolate_sigma(misfit: Floats, best: NDArray[np.intp]) -> Floats:
    """Return the (N,) px blurs where a parabola through the minimum of the (S, N) misfits and its
    neighbours has its own minimum.
    """
    centre = np.clip(best, 1, len(BLUR_SIGMAS) - 2)
    rows = np.arange(len(best))
    lower = misfit[centre - 1, rows]
    minimum = misfit[centre, rows]
    upper = misfit[centre + 1, rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.nan_to_num(np.clip((lower - upper) / (2 * (lower - 2 * minimum + upper)), -1, 1))
    return np.asarray(BLUR_SIGMAS[0] * (BLUR_SIGMAS[1] / BLUR_SIGMAS[0]) ** (centre + shift))


def _blur(
    grey: NDArray[np.uint8], lattice: Lattice, fits: list[_Edges], starts_white: NDArray[np.bool_]
) -> Blur | None:
    black = (fits[0].black + fits[1].black) / 2
    white = (fits[0].white + fits[1].white) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        product = (
            np.where(starts_white, 1, -1)
            * (2 * light_at(grey, lattice.corners) - black - white)
            / (white - black)
        )
    kinds = [product[starts_white], product[~starts_white]]
    if min(map(len, kinds)) < MIN_CORNERS:
        return None
    correlation = np.sin(np.pi / 2 * np.clip(np.mean([np.median(kind) for kind in kinds]), -1, 1))
    row_variance = fits[0].sigma ** 2
    column_variance = fits[1].sigma ** 2
    normals = edge_normals(lattice.steps)
    row_normal = _mean_direction(normals[:, 0])
    column_normal = -_mean_direction(normals[:, 1])
    widened = np.sqrt((row_variance + WEIGHT**2) * (column_variance + WEIGHT**2))
    return blur_of(
        row_normal,
        row_variance,
        column_normal,
        column_variance,
        float(correlation * widened - WEIGHT**2 * (column_normal @ row_normal)),
    )


def _normal_cdf(value: Floats) -> Floats:
    """Return the normal distribution function, accurate to 3e-4."""
    return np.asarray(0.5 * (1 + np.tanh((2 / np.pi) ** 0.5 * (value + 0.044715 * value**3))))


def _mean_direction(unit: Floats) -> Floats:
    """Return the (2,) unit direction of the mean of (N, 2)."""
    mean = unit.mean(0)
    return np.asarray(mean / np.linalg.norm(mean))
