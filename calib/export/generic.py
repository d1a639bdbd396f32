"""Write the non-central generic camera model of Schöps et al.: a line for every pixel, by cubic
B-splines over the picture, valid at every depth.

A grid of control points spans the picture. The second and the last but one of a row stand at the
picture's edges, so every pixel lies between four of them in either direction. One grid has points
on the lines, in m. Another has unit directions, and directions between them are normalised. The
control points are unit vectors, too, so they are found by iteration. Pixels count from the corner
of the picture. Where no ray leaves the cover, the lines are continued smoothly. The lines of a wide
lens may go in any direction, even behind the camera.

Source: T. Schöps et al., Why having 10,000 parameters in your camera model is better than twelve
(CVPR 2020); SaveCameraModel in
applications/camera_calibration/src/camera_calibration/io/calibration_io.cc and
generic_models/src/noncentral_generic.h of their program.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calib.calibration import Calibration
from calib.errors import InputError
from calib.export.export import ExportedFiles, ExportRequest
from calib.undistortion.grids import all_corners_true, interior_cells, midpoints
from calib.undistortion.ray_field import RayField
from calib.undistortion.spline import Spline

Array = NDArray[np.float64]

SPACINGS = (64, 32, 16, 8)
"""px between control points; the first that is fine enough is used."""
MAX_MISFIT = 0.005
"""px, at worst, of a spacing that is fine enough."""
CHECK_DISTANCE = 0.1
"""m: the distance at which the misfit is measured. It is smaller farther away."""
ITERATIONS = 20
"""Each one leaves at most about a tenth of the error."""


def export(request: ExportRequest) -> ExportedFiles:
    intrinsics = request.calibration.camera.intrinsics
    assert intrinsics
    pinhole = np.array([getattr(intrinsics, name).value for name in ("fx", "fy", "cx", "cy")])
    field = request.calibration.ray_field()
    if not field.valid.any():
        raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
    wide = request.calibration.model()[0].lens.wide
    exact = WideLines(request.calibration) if wide else PinholeLines(field, pinhole)
    advance = request.progress.task("Lines", len(SPACINGS))
    for done, spacing in enumerate(SPACINGS, start=1):
        points, directions = control_points(field, exact, spacing)
        rms, worst = spline_misfit(pinhole, exact, points, directions)
        advance(done, f"{spacing} px")
        if worst < MAX_MISFIT:
            break
    statement = (
        f"Misfit over the image: {rms:.4f} px RMS, {worst:.4f} px at worst, at"
        f" {CHECK_DISTANCE:g} m."
    )
    text = camera_yaml(field, points.coefficients, directions.coefficients, statement)
    return ExportedFiles(
        (request.files.write("intrinsics0.yaml", text),),
        remarks=(statement,) if worst >= MAX_MISFIT else (),
    )


class ExactLines(Protocol):
    """The lines that the splines approximate."""

    def at(self, pixels: Array) -> tuple[Array, Array]:
        """Return (N, 3) m, points on the lines of (N, 2) px, and their (N, 3) unit directions; a
        smooth continuation where the camera does not see.
        """
        ...

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        """Return (h - 1, w - 1), true where the camera sees midway between (w,) columns and (h,)
        rows.
        """
        ...


@dataclass(frozen=True, slots=True)
class PinholeLines:
    """The lines that an undistorted picture holds, from the ray field."""

    field: RayField
    pinhole: Array
    """(4,) px: focal lengths and principal point."""

    def at(self, pixels: Array) -> tuple[Array, Array]:
        return lines(self.field, self.pinhole, pixels)

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        return self.field.sees(*np.meshgrid(midpoints(columns), midpoints(rows)), np.inf)


@dataclass(frozen=True, slots=True)
class WideLines:
    """The traced lines of a wide lens; their points are those nearest to the pinhole.

    No spline follows the lens close to the end of its formula, so nothing there counts as visible.
    """

    calibration: Calibration

    def at(self, pixels: Array) -> tuple[Array, Array]:
        origins, directions = self.calibration.rays(pixels)
        valid = np.isfinite(directions).all(-1)
        nearest = np.flatnonzero(valid)[KDTree(pixels[valid]).query(pixels)[1]]
        origins = origins[nearest]
        directions = directions[nearest]
        return origins - (origins * directions).sum(-1, keepdims=True) * directions, directions

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        pixels = np.stack(np.meshgrid(columns, rows), -1)
        _, directions = self.calibration.rays(pixels.reshape(-1, 2))
        valid = np.isfinite(directions[:, 0]).reshape(pixels.shape[:2])
        return interior_cells(all_corners_true(valid))


def control_points(field: RayField, exact: ExactLines, spacing: float) -> tuple[Spline, Spline]:
    """Return splines through the lines' points and directions at nodes over the picture, one of
    them on each edge. Their coefficients are the control points; those of the directions are unit
    vectors.
    """
    columns = _nodes(field.width, spacing)
    rows = _nodes(field.height, spacing)
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    origins, directions = exact.at(pixels.reshape(-1, 2))
    origin = origins.reshape(*pixels.shape[:2], 3)
    direction = directions.reshape(*pixels.shape[:2], 3)
    aim = direction
    for _ in range(ITERATIONS):
        fitted = _unit_coefficients(Spline.through(columns, rows, aim))
        reached = fitted.at(pixels.reshape(-1, 2))[0].reshape(direction.shape)
        aim = aim + direction - reached / np.linalg.norm(reached, axis=-1, keepdims=True)
    return Spline.through(columns, rows, origin), fitted


def _nodes(size: int, spacing: float) -> Array:
    """Return the nodes over a side of this many px, from edge to edge."""
    return np.linspace(-0.5, size - 0.5, max(6, int(np.ceil(size / spacing)) + 1))


def lines(field: RayField, pinhole: Array, pixels: Array) -> tuple[Array, Array]:
    """Return the (N, 3) m points where the lines of (N, 2) px pass the plane z = 0 through the
    pinhole, and their (N, 3) unit directions.
    """
    focal = pinhole[:2]
    centre = pinhole[2:]
    at_infinity = field.undistort_pixels(pixels, np.inf)
    parallax = field.undistort_pixels(pixels, 1.0) - at_infinity
    points = np.concatenate([parallax / focal, np.zeros((len(pixels), 1))], -1)
    towards = np.concatenate([(at_infinity - centre) / focal, np.ones((len(pixels), 1))], -1)
    return points, towards / np.linalg.norm(towards, axis=-1, keepdims=True)


def spline_misfit(
    pinhole: Array, exact: ExactLines, points: Spline, directions: Spline
) -> tuple[float, float]:
    """Return the misfit in px, RMS and at worst, midway between the nodes where the camera sees.

    It is the distance between a splined line and the point at CHECK_DISTANCE on the exact line, as
    a pinhole camera of this focal length sees it that looks along the line.
    """
    pixels = np.stack(
        np.meshgrid(midpoints(points.nodes_x), midpoints(points.nodes_y)), -1
    ).reshape(-1, 2)
    pixels = pixels[exact.visible(points.nodes_x, points.nodes_y).ravel()]
    origins, exact_directions = exact.at(pixels)
    targets = origins + CHECK_DISTANCE * exact_directions
    splined = directions.at(pixels)[0]
    splined = splined / np.linalg.norm(splined, axis=-1, keepdims=True)
    separation = np.linalg.norm(np.cross(targets - points.at(pixels)[0], splined), axis=-1)
    error = pinhole[:2].mean() / CHECK_DISTANCE * separation
    return float(np.sqrt((error**2).mean())), float(error.max())


def camera_yaml(field: RayField, points: Array, directions: Array, statement: str) -> str:
    """Return the file's text with (h, w, 3) control points each.

    Its readers expect every key on one line, and the sizes first.
    """
    height, width = points.shape[:2]
    keys = {
        "type": "NoncentralGenericModel",
        "width": field.width,
        "height": field.height,
        "calibration_min_x": 0,
        "calibration_min_y": 0,
        "calibration_max_x": field.width - 1,
        "calibration_max_y": field.height - 1,
        "grid_width": width,
        "grid_height": height,
        "point_grid": f"[{', '.join(map(repr, points.ravel().tolist()))}]",
        "direction_grid": f"[{', '.join(map(repr, directions.ravel().tolist()))}]",
    }
    comment = (
        "# Lines of a camera behind a cover, by Refracal. The frame is the calibration's camera"
        " frame.\n"
    )
    return (
        comment + f"# {statement}\n" + "".join(f"{key} : {value}\n" for key, value in keys.items())
    )


def _unit_coefficients(spline: Spline) -> Spline:
    """Return the spline with normalised coefficients."""
    length = np.linalg.norm(spline.coefficients, axis=-1, keepdims=True)
    return replace(spline, coefficients=spline.coefficients / length)
