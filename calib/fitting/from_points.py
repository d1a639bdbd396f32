"""A calibration from arrays of points, with the arguments of cv2.calibrateCamera."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import Calibration
from calib.corners.point_views import views_of_points
from calib.corners.view import View
from calib.errors import InputError, wrong_type
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.intrinsics.spatial_target import plane_normal
from calib.io.array_arguments import numbers
from calib.progress import Progress, Silent
from calib.session.cover import Cover
from calib.session.cover_section import cover_to_yaml
from calib.session.point_target import PointTarget, PointView, join_places, near_origin
from calib.session.session import POINTS, TARGET_KEY, Session, session_from_mapping

CALL = "calibrate"
"""The origin of the arguments in messages."""
GRID_TOLERANCE = 0.01
"""The largest distance of a point from its place on the grid, as a fraction of a square's side."""
MAX_SQUARE = 0.5
"""m: with a cover, a larger square is taken for one in other units."""

Array = NDArray[np.float64]


def calibrate(
    object_points: Sequence[ArrayLike],
    image_points: Sequence[ArrayLike],
    size: tuple[int, int],
    camera_matrix: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
    *,
    cover: Cover | Mapping[str, object] | Sequence[Mapping[str, object]] | None = None,
    settings: Settings = Settings(),
    progress: Progress = Silent(),
) -> Calibration:
    """Calibrate a camera from points of a flat board or of a target in space, as
    cv2.calibrateCamera takes them. Points in space need no start of the camera matrix.

    Args:
        object_points: for each view, (N, 3) m points on the board: a grid of squares with z = 0. A
            view may show a part of the grid. Or points that are not on a plane, at any places.
        image_points: for each view, the (N, 2) px of these points; NaN where a point was not found.
        size: width and height of the pictures, px.
        camera_matrix: (3, 3) px, if it is known. It is needed if there is a cover: calibrate
            without the cover first.
        distortion: the coefficients that belong to `camera_matrix`, in the order of cv2: 4, 5, 8,
            12 or 14.
        cover: the cover, as the key of session.yaml has it, such as {"shape": "dome",
            "inner_radius_mm": 50, "centre_mm": [0, 0, 0], "thickness_mm": 3,
            "refractive_index": 1.49}; None for a camera without one.

    Raises:
        WrongTypeError: an argument is of another type.
        InputError: the points are on a plane and no grid, or do not belong together.
        NotEnoughDataError: too few views show enough of the board.
    """
    width, height = _check_size(size)
    described_cover = _cover_mapping(cover)
    objects = _rows(object_points, 3, "object_points")
    pixels = _rows(image_points, 2, "image_points")
    if len(objects) != len(pixels):
        raise InputError(
            f"object_points has {len(objects)} views and image_points {len(pixels)}: give the"
            " points of each view in both."
        )
    points = [
        _check_view(f"view {index}", places, seen, (width, height))
        for index, (places, seen) in enumerate(zip(objects, pixels, strict=True))
    ]
    _check_points(objects)
    grid = None if plane_normal(np.concatenate(objects)) is None else _Grid.around(objects)
    camera: dict[str, object] = {"width": width, "height": height}
    if camera_matrix is not None:
        camera["intrinsics"] = _intrinsics(camera_matrix, distortion)
    elif distortion is not None:
        raise InputError("distortion is given without camera_matrix: give both, or none of them.")
    mapping = {"camera": camera, "cover": described_cover}
    mapping |= {"board": grid.section} if grid else {TARGET_KEY: {"type": POINTS}}
    board, described, glass = session_from_mapping(mapping, CALL)
    if grid:
        views = tuple(grid.view(view) for view in points)
    else:
        board = PointTarget.of(near_origin(join_places(points)))
        views = tuple(replace(view, covariance=None) for view in views_of_points(points))
    if glass.shape != "none":
        if camera_matrix is None:
            raise InputError(
                "camera_matrix is missing: calibrate the camera without its cover first, and give"
                " camera_matrix=bare.K and distortion=bare.distortion."
            )
        if board.square > MAX_SQUARE:
            raise InputError(
                f"object_points are {board.square:g} m apart: give metres, such as object_points /"
                " 1000 for millimetres."
            )
    session = Session(Path("SESSION"), board, described, glass, (), None, None)
    return fit(session, settings, progress, views=views)


class _Grid:
    """The grid on which all points of a board lie."""

    def __init__(self, corner: Array, square: float, columns: int, rows: int) -> None:
        """`corner` is the (2,) point with the least x and y, in m."""
        self.corner = corner
        self.square = square
        self.columns = columns
        self.rows = rows

    @property
    def section(self) -> dict[str, object]:
        """The key board of session.yaml."""
        return {"columns": self.columns, "rows": self.rows, "square_mm": 1e3 * self.square}

    @staticmethod
    def around(objects: Sequence[Array]) -> "_Grid":
        """Return the smallest grid that holds the points of all views."""
        points = np.concatenate(objects)
        extent = float(np.ptp(points[:, :2], axis=0).max())
        if np.abs(points[:, 2]).max() > GRID_TOLERANCE * extent:
            raise InputError(
                "object_points are on a plane, and not on z = 0: give z = 0 for every point of a"
                " flat board."
            )
        steps = np.concatenate([np.diff(np.sort(points[:, axis])) for axis in (0, 1)])
        steps = steps[steps > 1e-4 * extent]
        square = float(np.median(steps[steps < 1.5 * steps.min()])) if len(steps) else 0.0
        corner = points[:, :2].min(0)
        if square > 0:
            count = (points[:, :2].max(0) - corner) / square
            columns, rows = np.rint(count).astype(int) + 1
            grid = _Grid(corner, extent / max(columns - 1, rows - 1), int(columns), int(rows))
            places = (points[:, :2] - corner) / grid.square
            if np.abs(places - np.rint(places)).max() < GRID_TOLERANCE:
                return grid
        raise InputError(
            "object_points are no grid of squares: give the corners of a checkerboard, x and y in"
            " steps of its squares' side."
        )

    def view(self, view: PointView) -> View:
        """Return a view of points of the grid."""
        column, row = np.rint((view.places[:, :2] - self.corner) / self.square).astype(int).T
        places = row * self.columns + column
        if len(set(places.tolist())) < len(places):
            raise InputError(
                f"{view.name} has one of its object_points twice: give each point once."
            )
        corners = np.full((self.columns * self.rows, 2), np.nan)
        corners[places] = view.pixels
        return View(view.name, corners, np.isfinite(corners[:, 0]).astype(np.float64))


def _check_points(objects: Sequence[Array]) -> None:
    """Raise InputError if there are no points, or one is not finite."""
    points = np.concatenate([np.zeros((0, 3)), *objects])
    if not len(points):
        raise InputError("object_points holds no point: give the corners of each view.")
    if not np.isfinite(points).all():
        raise InputError("object_points has a point that is not finite: give the board's own.")


def _check_view(name: str, points: Array, pixels: Array, size: tuple[int, int]) -> PointView:
    """Return the view of the points (N, 3) m that are seen at (N, 2) px, without those that are
    not seen. Its covariances are those of 1 px.
    """
    if len(points) != len(pixels):
        raise InputError(
            f"{name} has {len(points)} object_points and {len(pixels)} image_points: give one"
            " pixel for each point."
        )
    visible = np.isfinite(pixels).all(-1)
    outside = ((pixels < -0.5) | (pixels > np.array(size) - 0.5)).any(-1)
    if outside.any():
        x, y = pixels[outside][0]
        raise InputError(
            f"{name} has a point at ({x:g}, {y:g}), outside {size[0]}x{size[1]} px: give size"
            " as (width, height), and points of this picture."
        )
    covariance = np.tile(np.eye(2), (int(visible.sum()), 1, 1))
    return PointView(name, pixels[visible], points[visible], covariance)


def _rows(views: Sequence[ArrayLike], width: int, name: str) -> list[Array]:
    """Return the (N, width) points of each view; cv2's (N, 1, width) are taken as well."""
    advice = f"a list with an array of shape (N, {width}) for each view"
    if isinstance(views, str | Mapping) or not hasattr(views, "__len__"):
        raise wrong_type(name, views, advice)
    rows = []
    for index, view in enumerate(views):
        array: Any = np.asarray(view)
        if array.ndim == 3 and 1 in array.shape[:2]:
            array = array.reshape(-1, array.shape[2])
        rows.append(numbers(array, (None, width), f"{name}[{index}]"))
    return rows


def _check_size(size: tuple[int, int]) -> tuple[int, int]:
    if isinstance(size, str) or not hasattr(size, "__len__"):
        raise wrong_type("size", size, "(width, height) of the pictures in px")
    width, height = numbers(size, (2,), "size").tolist()
    if width % 1 or height % 1:
        raise InputError(f"size is ({width:g}, {height:g}): give width and height in whole px.")
    return int(width), int(height)


def _intrinsics(camera_matrix: ArrayLike, distortion: ArrayLike | None) -> dict[str, object]:
    matrix = numbers(camera_matrix, (3, 3), "camera_matrix")
    coefficients = np.zeros(0) if distortion is None else np.ravel(np.asarray(distortion))
    return {
        "fx": float(matrix[0, 0]),
        "fy": float(matrix[1, 1]),
        "cx": float(matrix[0, 2]),
        "cy": float(matrix[1, 2]),
        "distortion": numbers(coefficients, (None,), "distortion").tolist(),
    }


def _cover_mapping(
    cover: Cover | Mapping[str, object] | Sequence[Mapping[str, object]] | None,
) -> object:
    match cover:
        case None:
            return {"shape": "none"}
        case Cover():
            return cover_to_yaml(cover)
        case Mapping():
            return dict(cover)
        case list() | tuple():
            return [dict(single) if isinstance(single, Mapping) else single for single in cover]
    advice = 'a mapping as in session.yaml, such as {"shape": "dome", "inner_radius_mm": 50, ...}'
    raise wrong_type("cover", cover, advice)
