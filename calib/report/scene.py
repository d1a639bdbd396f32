"""Figures: camera, cover and boards in space, and the cover from the side and from above with the
rays that it bends.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from calib.fitting.declared import comparisons
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.vector import Vector
from calib.report.chart import border_pixels
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.session.parameter_names import CAMERA

MAX_RAYS = 600
"""Rays in a page, of all views together."""
LINE_RAYS = 9
"""Rays of a view through the middle row of its board, and as many through its middle column."""
RED = 3.0
"""The error over the corners' noise from which a board is red."""
MESH = (49, 17)
"""Points of a surface around and along the cover."""
PROFILE_POINTS = 161
AROUND, AHEAD = 120.0, 75.0
"""Degrees from straight ahead up to which a round cover is drawn, and at most a flat one."""
MARGIN = 12.0
"""Degrees of a cover that are drawn beyond the picture's border."""


@dataclass(frozen=True, slots=True)
class Ways:
    """The ways of rays from the lens through every surface of the cover."""

    points: Array
    """(N, S + 1, 3) m: where the ray begins, and where it meets each surface."""
    direction: Array
    """(N, 3) unit, behind the last surface."""
    arrived: NDArray[np.bool_]
    """(N,)"""


def session_in_space(evidence: Evidence) -> Drawing:
    shown = corners_with_rays(evidence)
    border = border_pixels(evidence, 1)
    border_count = len(border)
    traced = ways(evidence, np.concatenate([border, evidence.pixels[shown]]))
    arrived = traced.arrived[border_count:]
    ends = evidence.points[shown]
    board = evidence.calibration.board
    places = board.points()
    lines = "its middle row and column" if board.has_grid else "some of its points"
    cover = ", its cover as fitted," if evidence.path.cover else ""
    return Drawing(
        "scene",
        "The session in space",
        f"The camera{cover} and every board where it stood. Drag to turn it. Click into it, then"
        " scroll to zoom. A board's colour is its error: blue is the corners' noise, red three"
        f" times as much. Point at a board to see the rays of {lines}, bent by the glass. Click it"
        " to see its picture.",
        {
            "half": [half + board.square for half in board.half],
            "box": None if board.is_flat else np.stack([places.min(0), places.max(0)]),
            "surfaces": surface_meshes(evidence),
            "border": traced.points[:border_count],
            "borderDirection": traced.direction[:border_count],
            "rays": np.concatenate([traced.points[border_count:], ends[:, None]], 1)[arrived],
            "rayCorner": evidence.corner[shown][arrived],
            "rayView": evidence.view[shown][arrived],
            "reach": list(evidence.reach),
            "errors": _error_range(evidence),
        },
    )


def side_view(evidence: Evidence) -> Drawing | None:
    """Return None without a cover, or if the target has no middle row and column."""
    if not (evidence.path.cover and evidence.calibration.board.has_grid):
        return None
    values = cover_values(evidence)
    origins = [
        interface.frame.at(values).shift.stacked().tolist() for interface in evidence.path.cover
    ]
    return Drawing(
        "side-view",
        "The cover from the side and from above",
        "Cuts through the pinhole, to scale. Rays go from the lens through the glass to the corners"
        " of one board's middle column and row. Click into a panel, and the wheel shows more of"
        " them; the list chooses the board. The numbers are those of the table above.",
        {
            "profiles": profiles(evidence),
            "origin": origins[-1],
            "round": _is_round(evidence),
            "numbers": [
                [number.name.removeprefix("cover."), number.estimated]
                for number in comparisons(evidence.calibration)
                if not CAMERA.has(number.name)
            ],
        },
    )


def cover_values(evidence: Evidence) -> Values:
    """Return the values with the numbers of the cover, which for a window that only the diagnosis
    knows are those of its effect.
    """
    pixel = torch.from_numpy(evidence.pixels[:1])
    return evidence.path.adjust_pixels(pixel, evidence.values, MIDDLE)[1]


def _error_range(evidence: Evidence) -> tuple[float, float]:
    """Return the error (px) of a board that is drawn in the first colour, and in the last."""
    noise = evidence.calibration.noise_px
    if noise:
        return noise, RED * noise
    errors = np.asarray(evidence.rms_by_view)
    return float(errors.min()), float(errors.max())


def corners_with_rays(evidence: Evidence) -> NDArray[np.int64]:
    """Return (N,) corners: of every view some of those nearest to its board's middle row and
    column, or some of its points.
    """
    board = evidence.calibration.board
    if not board.has_grid:
        rays = min(MAX_RAYS, len(evidence.corner))
        return np.linspace(0, len(evidence.corner) - 1, rays).astype(np.int64)
    row, column = np.divmod(evidence.corner, board.columns)
    count = max(1, min(LINE_RAYS, MAX_RAYS // (2 * len(evidence.calibration.views))))
    in_lines = np.zeros(len(row), np.bool_)
    for line, along, lines, places in (
        (row, column, board.rows, board.columns),
        (column, row, board.columns, board.rows),
    ):
        chosen = np.unique(np.rint(np.linspace(0, places - 1, count)).astype(np.int64))
        in_lines |= (line == lines // 2) & np.isin(along, chosen)
    return np.flatnonzero(in_lines)


def ways(evidence: Evidence, pixels: Array) -> Ways:
    """Trace (N, 2) px from surface to surface."""
    path = evidence.path
    adjusted, values = path.adjust_pixels(torch.from_numpy(pixels), evidence.values, MIDDLE)
    rays = path.lens(adjusted, values, None)
    points = [rays.origin.stacked()]
    for interface in path.cover:
        rays = interface(rays, values)
        points.append(rays.origin.stacked())
    return Ways(
        torch.stack([point.expand(len(pixels), 3) for point in points], 1).numpy(),
        rays.direction.stacked().numpy(),
        (rays.failure == 0).numpy(),
    )


def surface_meshes(evidence: Evidence) -> list[Array]:
    """Return (rows, columns, 3) m for each surface of the cover, as it is around the camera; NaN
    where a line from the pinhole misses it.
    """
    around, along = _extent(evidence)
    azimuth = np.linspace(-around, around, MESH[0])
    elevation = np.linspace(-along, along, MESH[1])
    return _surface_points(evidence, *np.meshgrid(azimuth, elevation))


def profiles(evidence: Evidence) -> dict[str, list[Array]]:
    """Return (N, 3) m for each surface of the cover, cut by the planes x = 0 and y = 0."""
    around, along = _extent(evidence)
    turn = np.linspace(-1, 1, PROFILE_POINTS)
    return {
        "side": _surface_points(
            evidence, 0 * turn, (AROUND if _is_dome(evidence) else along) * turn
        ),
        "above": _surface_points(evidence, around * turn, 0 * turn),
    }


def _surface_points(evidence: Evidence, azimuth: Array, elevation: Array) -> list[Array]:
    """Return (..., 3) m: where straight lines from the pinhole meet each smooth surface.

    Args:
        azimuth: (...) degrees, to the right of straight ahead.
        elevation: (...) degrees, downwards.
    """
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    directions = np.stack(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ],
        -1,
    )
    meshes = []
    values = cover_values(evidence)
    zero = torch.zeros((), dtype=torch.float64)
    for interface in evidence.path.cover:
        frame = interface.frame.at(values)
        height = sum((values[name] for name in interface.thicknesses), zero)
        distance, missed = interface.surface.reach(
            frame.enter(Vector(zero, zero, zero)),
            frame.turn(Vector.of(torch.from_numpy(directions))),
            height,
            values,
        )
        distance = torch.where(missed | (distance <= 0), torch.nan, distance)
        meshes.append(distance.numpy()[..., None] * directions)
    return meshes


@lru_cache(maxsize=1)  # of the scene and of the side view
def _extent(evidence: Evidence) -> tuple[float, float]:
    """Return the degrees to both sides, and up and down, in which the cover is drawn."""
    directions = ways(evidence, border_pixels(evidence, 5)).direction
    sideways, down, ahead = np.abs(directions[np.isfinite(directions).all(-1)]).T
    across = float(np.degrees(np.arctan2(sideways, ahead)).max()) + MARGIN
    along = float(np.degrees(np.arctan2(down, ahead)).max()) + MARGIN
    return AROUND if _is_round(evidence) else min(across, AHEAD), min(along, AHEAD)


def _is_dome(evidence: Evidence) -> bool:
    """True if the outermost cover is round in the vertical cut as well."""
    return "centre.z" in evidence.calibration.cover.covers[-1].parameters


def _is_round(evidence: Evidence) -> bool:
    covers = evidence.calibration.cover.covers
    return "inner_radius" in covers[-1].parameters
