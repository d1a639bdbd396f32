"""Maps that make a pair of cameras row-aligned: a point shows in the same row of both pictures.

Behind a cover this is exact at one depth only, because the rays of a camera do not meet in one
point. Each rectified picture is that of a pinhole; the two pinholes look in the same direction and
are displaced along the rows. At the chosen depth, every rectified pixel shows what the pinhole
would see there. At other depths, rows are off by some hundredths or tenths of a pixel. The
direction is chosen so that this is least over a range of depths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.errors import InputError
from calib.optics.rotation import matrix
from calib.rig.rig import Rig
from calib.rig.rig_geometry import placed_cameras
from calib.rig.triangulation import PlacedCamera
from calib.threads import single_thread
from calib.undistortion.grids import all_corners_true, cell_index, extrapolate, grid_nodes
from calib.undistortion.ray_field import check_depth
from calib.undistortion.spline import Spline

LATTICE = (11, 9)
"""Points across and down at which rows are compared."""
DEPTHS = 5
"""The number of depths of the range at which rows are compared, even in inverse depth."""
MAP_STEP = 16
"""Pixels between the nodes at which a map is exact; in between it is cubic."""
TURN_TOLERANCE = 1e-4
"""The relative tolerance of the choice of the direction: rows depend on it to second order."""
TURN_SCALE = 1e-3
"""rad: the size of a typical change of the direction."""

Array = NDArray[np.float64]
Map = tuple[NDArray[np.float32], NDArray[np.float32]]
"""(height, width) x and y of the pixels of a picture, px."""


@dataclass(frozen=True, slots=True)
class RowError:
    """The px by which the rows of the two pictures are off at a depth."""

    depth: float
    """m"""
    rms_px: float
    worst_px: float


@dataclass(frozen=True, slots=True, eq=False)
class RectifiedPair:
    """A pair of row-aligned pinholes, and the maps to their pictures."""

    names: tuple[str, str]
    depth: float
    """m, from the pinholes, at which the maps are exact."""
    rotation: Array
    """(3, 3) from the reference's frame to that of the rectified pinholes."""
    centres: tuple[Array, Array]
    """(3,) m, the pinholes in the reference's frame."""
    focal: float
    """px"""
    principal: tuple[float, float]
    """px"""
    size: tuple[int, int]
    """px, width and height."""
    maps: tuple[Map, ...]
    """For each picture, (height, width) x and y of the pixel that it shows, for cv2.remap; -1 where
    the camera does not see it.
    """
    rows: tuple[RowError, ...]
    """The px by which rows are off, near to far."""

    @property
    def baseline(self) -> float:
        """The distance between the pinholes, m: depth is focal * baseline / disparity, to the
        accuracy of `rows`.
        """
        return float(np.linalg.norm(self.centres[1] - self.centres[0]))

    @property
    def projections(self) -> tuple[Array, Array]:
        """The (3, 4) projection matrices as cv2.stereoRectify gives them."""
        (x, y), f = self.principal, self.focal
        first = np.array([[f, 0, x, 0], [0, f, y, 0], [0, 0, 1, 0.0]])
        second = first.copy()
        second[0, 3] = -f * self.baseline
        return first, second


def rectify(
    rig: Rig, names: tuple[str, str], depth: float, depths: tuple[float, float] | None = None
) -> RectifiedPair:
    """Return the maps that make two cameras of a rig row-aligned at a depth.

    Args:
        rig: the calibrated rig.
        names: the left and the right camera.
        depth: m, at which the maps are exact.
        depths: m, the range over which rows should be off as little as possible; by default from
            half the depth to twice the depth.

    Raises:
        InputError: the rig has no such cameras, or they do not see the depth.
    """
    check_depth(depth)
    if len(set(names)) != 2:
        raise InputError("A pair is two different cameras: name the left and the right one.")
    cameras = [placed_cameras(rig)[rig.index(name)] for name in names]
    near, far = depths or (depth / 2, 2 * depth)
    first = rig.calibrations[names[0]].camera
    size = first.width, first.height
    focal = float(np.mean([rig.calibrations[name].K[[0, 1], [0, 1]].mean() for name in names]))
    principal = (size[0] - 1) / 2, (size[1] - 1) / 2
    inverse = np.linspace(1 / far, 1 / near, DEPTHS)
    with single_thread():
        centres = [_centre(rig, name) for name in names]
        start = _start(rig, names, centres[1] - centres[0])

        def pinholes(turn: Array) -> tuple[Array, tuple[Array, Array]]:
            rotation = matrix(torch.from_numpy(TURN_SCALE * turn)).numpy() @ start
            length = float(rotation[0] @ (centres[1] - centres[0]))
            return rotation, (centres[0], centres[0] + length * rotation[0])

        def off(turn: Array) -> Array:
            rotation, places = pinholes(turn)
            lens = focal, principal, size
            return np.nan_to_num(_rows(cameras, rotation, places, lens, depth, 1 / inverse).ravel())

        solution = least_squares(off, np.zeros(3), xtol=TURN_TOLERANCE, ftol=TURN_TOLERANCE)
        rotation, places = pinholes(solution.x)
        lens = focal, principal, size
        shown_depths = np.array(sorted({*(1 / inverse).tolist(), depth}))
        rows = _rows(cameras, rotation, places, lens, depth, shown_depths)
        errors = [_row_error(at_depth, at) for at_depth, at in zip(rows, shown_depths, strict=True)]
        maps = tuple(
            _map(camera, rotation, place, lens, depth)
            for camera, place in zip(cameras, places, strict=True)
        )
    if all((x < 0).all() for x, _ in maps):
        raise InputError(f"The cameras do not see the depth of {depth:g} m: choose another depth.")
    return RectifiedPair(
        names=names,
        depth=depth,
        rotation=rotation,
        centres=places,
        focal=focal,
        principal=principal,
        size=size,
        maps=maps,
        rows=tuple(errors),
    )


Lens = tuple[float, tuple[float, float], tuple[int, int]]
"""Focal length (px), principal point (px) and size (px) of the rectified pictures."""


def _centre(rig: Rig, name: str) -> Array:
    """Return the (3,) m pinhole of a camera in the reference's frame."""
    pose = rig.mounting(name).T_camera_reference
    return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


def _start(rig: Rig, names: Sequence[str], baseline: Array) -> Array:
    """Return the (3, 3) rotation to rows along the baseline, looking as both cameras do."""
    axes = [rig.mounting(name).T_camera_reference[2, :3] for name in names]
    x = baseline / np.linalg.norm(baseline)
    y = np.cross(np.sum(axes, 0), x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def _rows(
    cameras: Sequence[PlacedCamera],
    rotation: Array,
    places: Sequence[Array],
    lens: Lens,
    depth: float,
    at: Array,
) -> Array:
    """Return (K, N) px: the rows of points at the (K,) depths `at` in the first picture minus those
    in the second, for maps that are exact at `depth`; NaN for a point that one camera does not see.
    """
    focal, principal, size = lens
    grid = [np.linspace(0, length - 1, count) for length, count in zip(size, LATTICE, strict=True)]
    pixels = np.stack(np.meshgrid(*grid), -1).reshape(-1, 2)
    middle = (places[0] + places[1]) / 2
    points = np.concatenate([_points(pixels, rotation, middle, lens, float(z)) for z in at])
    rows = []
    for camera, place in zip(cameras, places, strict=True):
        projected = camera.project(torch.from_numpy(points))
        origins, directions = camera.rays(torch.where(projected.isnan(), 0.0, projected))
        origin = (origins.numpy() - place) @ rotation.T
        direction = directions.numpy() @ rotation.T
        y = origin[:, 1] + direction[:, 1] * (depth - origin[:, 2]) / direction[:, 2]
        is_inside = ((projected >= -0.5) & (projected <= torch.tensor(size) - 0.5)).all(-1).numpy()
        rows.append(np.where(is_inside, focal * y / depth + principal[1], np.nan))
    return np.asarray(rows[0] - rows[1]).reshape(len(at), -1)


def _row_error(rows: Array, depth: float) -> RowError:
    projected = rows[np.isfinite(rows)]
    if not len(projected):
        return RowError(float(depth), float("nan"), float("nan"))
    return RowError(
        float(depth), float(np.sqrt(np.mean(projected**2))), float(np.abs(projected).max())
    )


def _points(pixels: Array, rotation: Array, place: Array, lens: Lens, depth: float) -> Array:
    """Return the (N, 3) m points in the reference's frame that a rectified pinhole sees at a depth
    in (N, 2) px.
    """
    focal, principal, _ = lens
    directions = np.column_stack([(pixels - principal) / focal, np.ones(len(pixels))])
    return np.asarray(place + depth * directions @ rotation)


def _map(camera: PlacedCamera, rotation: Array, place: Array, lens: Lens, depth: float) -> Map:
    """Return the (height, width) map of one picture."""
    width, height = lens[2]
    nodes_x = grid_nodes(width, MAP_STEP, 0.0)
    nodes_y = grid_nodes(height, MAP_STEP, 0.0)
    pixels = np.stack(np.meshgrid(nodes_x, nodes_y), -1).reshape(-1, 2)
    points = _points(pixels, rotation, place, lens, depth)
    projected = camera.project(torch.from_numpy(points)).numpy()
    nodes = projected.reshape(len(nodes_y), len(nodes_x), 2)
    valid = np.isfinite(nodes).all(-1)
    if not valid.any():
        empty = np.full((height, width), -1, np.float32)
        return empty, empty
    columns, lines = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
    spline = Spline.through(nodes_x, nodes_y, extrapolate(nodes, valid))
    values = spline.on_grid(columns, lines)
    cells = all_corners_true(valid)
    mask = cells[np.ix_(cell_index(lines, nodes_y), cell_index(columns, nodes_x))]
    is_inside = (values > -0.5).all(-1) & (values < np.array([width, height]) - 0.5).all(-1) & mask
    x, y = np.moveaxis(np.where(is_inside[..., None], values, -1.0), -1, 0).astype(np.float32)
    return x, y
