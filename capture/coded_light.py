"""How a picture smears the edges of a board with markers, and how the board is lit.

As on a checkerboard; but the white of a ChArUco's square is a narrow rim, and a marker begins
behind it. So the profile across an edge is compared with that of a blurred rim, whose width is
known, for a row of blurs: black and white come out as they were before the blur. Corners that have
black to one side and those that have it to the other take turns along a row, so that what a marker
does to the light of one kind it undoes in the other.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.lattice import Lattice, edge_normals
from calib.session.board import Board
from calib.session.coding import Charuco
from capture.exposure import FULL, VIDEO_FULL, Exposure
from capture.sharpness import FARTHEST, REACH, WEIGHT, Blur, blur_of, light_at, sampled

Floats = NDArray[np.float64]

ALONG = np.linspace(
    0.2, 0.45, 6
)  # of the step to the next corner: clear of the other edge, and before this one ends
ACROSS = np.linspace(-1, 1, 33)  # places on a profile, in reaches
SIGMAS = np.geomspace(0.35, 5.0, 20)  # px, blurs that are tried
NEAR = (0.4, 1.0)  # of the clear way beside an edge: where its colour is told
WORST = 25  # percent of the corners, beside which there may be a hand
MOST = 48  # corners, drawn from all: more tell no more
FEWEST = 4  # corners of either kind, or edges in either direction


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    blur: Blur | None
    """None where there are no edges to speak of."""
    exposure: Exposure


def measure_light(grey: NDArray[np.uint8], corners: Floats, board: Board) -> Light:
    """Around the (count, 2) px corners, NaN where not seen, of a (H, W) picture."""
    lattice = _some(Lattice.from_corners(corners, board))
    rim = (
        (1 - board.coding.marker / board.square) / 2
        if isinstance(board.coding, Charuco)
        else np.inf
    )
    reach = np.minimum(
        (REACH if np.isfinite(rim) else lattice.clearance) * lattice.heights, FARTHEST
    )  # (N, edge) px, to either side
    across = (
        lattice.steps[:, ::-1] * (reach / lattice.heights)[..., None]
    )  # (N, edge, 2) px: along the other edge
    along = (
        np.concatenate([-ALONG[::-1], ALONG])[:, None] * lattice.steps[:, :, None]
    )  # (N, edge, along, 2)
    places = (
        lattice.corners[:, None, None, None]
        + along[..., None, :]
        + ACROSS[:, None] * across[:, :, None, None]
    )
    light = sampled(grey, places).reshape(
        len(places), 2, 2, len(ALONG), len(ACROSS)
    )  # by corner, edge, and side of the corner along it
    inside = (
        np.abs(ACROSS) * (reach / (lattice.clearance * lattice.heights))[..., None]
    )  # (N, edge, ACROSS)
    near = ((inside > NEAR[0]) & (inside < NEAR[1]))[:, :, None, None]
    behind = (light * (near & (ACROSS > 0))).sum((-1, -2)) - (light * (near & (ACROSS < 0))).sum(
        (-1, -2)
    )  # (N, edge, side)
    starts_white = (behind * [-1, 1]).sum(
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
        np.broadcast_to(white_behind[..., None, None] == (ACROSS > 0), light.shape) & near
    ]
    brightest = light.max()
    clipped = (
        float((white >= min(brightest, FULL)).mean())
        if brightest >= VIDEO_FULL and white.size
        else 0.0
    )
    contrast = float(np.percentile(np.concatenate([fit.white - fit.black for fit in fits]), WORST))
    return Light(_blur(grey, lattice, fits, starts_white), Exposure(clipped, contrast))


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """N corners' edges of one direction, each in the mean of what is found to both sides of the
    corner.
    """

    sigma: float
    """px, of the blur across them."""
    black: Floats
    """(N,) grey levels, before the blur."""
    white: Floats

    @staticmethod
    def of(profiles: Floats, reach: Floats, rim: Floats) -> "_Edges":
        """From (N, 2, ACROSS) grey levels, over (N,) px to either side, white behind the edge for
        (N,) px.
        """
        at = ACROSS * reach[:, None]  # (N, ACROSS) px
        counts = (at <= rim[:, None]).astype(np.float64)
        part = np.array(
            [_normal_below(at / s) - _normal_below((at - rim[:, None]) / s) for s in SIGMAS]
        )  # (S, N, ACROSS) white's share
        profile = profiles.mean(1)
        total = counts.sum(1)
        middle, level = (
            (part * counts).sum(-1) / total,
            (profile * counts).sum(-1) / total,
        )  # (S, N), (N,)
        apart, rest = (part - middle[..., None]) * counts, profile - level[:, None]
        gain = (apart * rest).sum(-1) / np.maximum((apart**2).sum(-1), 1e-9)  # (S, N)
        misfit = (counts * (rest - gain[..., None] * (part - middle[..., None])) ** 2).sum(-1)
        best = misfit.argmin(0)
        rows = np.arange(len(at))
        black = level - (gain * middle)[best, rows]
        return _Edges(float(np.median(_between(misfit, best))), black, black + gain[best, rows])


def _some(lattice: Lattice) -> Lattice:
    drawn = np.random.default_rng(0).permutation(len(lattice.corners))[:MOST]
    return replace(
        lattice,
        corners=lattice.corners[drawn],
        steps=lattice.steps[drawn],
        curvatures=lattice.curvatures[drawn],
    )


def _between(misfit: Floats, best: NDArray[np.intp]) -> Floats:
    """(N,) px, where a parabola through the least of (S, N) and its neighbours is least."""
    middle = np.clip(best, 1, len(SIGMAS) - 2)
    before, here, after = (misfit[middle + step, np.arange(len(best))] for step in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.nan_to_num(np.clip((before - after) / (2 * (before - 2 * here + after)), -1, 1))
    return np.asarray(SIGMAS[0] * (SIGMAS[1] / SIGMAS[0]) ** (middle + shift))


def _blur(
    grey: NDArray[np.uint8], lattice: Lattice, fits: list[_Edges], starts_white: NDArray[np.bool_]
) -> Blur | None:
    black, white = (
        (one + other) / 2
        for one, other in ((fits[0].black, fits[1].black), (fits[0].white, fits[1].white))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        product = (
            np.where(starts_white, 1, -1)
            * (2 * light_at(grey, lattice.corners) - black - white)
            / (white - black)
        )
    kinds = [product[starts_white], product[~starts_white]]
    if min(map(len, kinds)) < FEWEST:
        return None
    correlation = np.sin(np.pi / 2 * np.clip(np.mean([np.median(kind) for kind in kinds]), -1, 1))
    row, column = (fit.sigma**2 for fit in fits)
    row_normal, column_normal = (
        sign * _mean_direction(edge_normals(lattice.steps)[:, edge])
        for edge, sign in ((0, 1), (1, -1))
    )
    widened = np.sqrt((row + WEIGHT**2) * (column + WEIGHT**2))
    return blur_of(
        row_normal,
        row,
        column_normal,
        column,
        float(correlation * widened - WEIGHT**2 * (column_normal @ row_normal)),
    )


def _normal_below(value: Floats) -> Floats:
    """The normal distribution, to 3e-4."""
    return np.asarray(0.5 * (1 + np.tanh((2 / np.pi) ** 0.5 * (value + 0.044715 * value**3))))


def _mean_direction(unit: Floats) -> Floats:
    """(2,) unit, of (N, 2)."""
    mean = unit.mean(0)
    return np.asarray(mean / np.linalg.norm(mean))
