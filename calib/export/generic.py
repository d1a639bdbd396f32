"""Write the non-central generic camera model of Schöps et al.: a line for every pixel, by cubic
B-splines over the picture, valid at every depth.

A grid of control points spans the picture. The second and the last but one of a row stand at the
picture's edges, so every pixel lies between four of them in either direction. One grid has points
on the lines, in m. Another has unit directions, and directions between them are normalised. The
control points are unit vectors, too, so they are found by iteration. Pixels count from the corner
of the picture. Where no ray leaves the cover, the lines are continued smoothly.

Source: T. Schöps et al., Why having 10,000 parameters in your camera model is better than twelve
(CVPR 2020); SaveCameraModel in
applications/camera_calibration/src/camera_calibration/io/calibration_io.cc and
generic_models/src/noncentral_generic.h of their program.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.export.export import ExportedFiles, ExportRequest
from calib.undistortion.grids import midpoints
from calib.undistortion.ray_field import RayField
from calib.undistortion.spline import Spline

Array = NDArray[np.float64]

SPACINGS = (64, 32, 16, 8)
"""px between control points; the first that is fine enough is used."""
MAX_MISFIT = 0.005
"""px, at worst, of a spacing that is fine enough."""
CHECK_DEPTH = 0.1
"""m: the depth where the misfit is measured. It is smaller at larger depths."""
ITERATIONS = 20
"""Each one leaves at most about a tenth of the error."""


def export(request: ExportRequest) -> ExportedFiles:
    intrinsics = request.calibration.camera.intrinsics
    assert intrinsics
    pinhole = np.array([getattr(intrinsics, name).value for name in ("fx", "fy", "cx", "cy")])
    field = request.calibration.ray_field()
    if not field.valid.any():
        raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
    advance = request.progress.task("Lines", len(SPACINGS))
    for done, spacing in enumerate(SPACINGS, start=1):
        points, directions = control_points(field, pinhole, spacing)
        rms, worst = misfit(field, pinhole, points, directions)
        advance(done, f"{spacing} px")
        if worst < MAX_MISFIT:
            break
    statement = (
        f"Misfit over the image: {rms:.4f} px RMS, {worst:.4f} px at worst, at {CHECK_DEPTH:g} m."
    )
    text = camera_yaml(field, points.coefficients, directions.coefficients, statement)
    return ExportedFiles(
        (request.files.write("intrinsics0.yaml", text),),
        remarks=(statement,) if worst >= MAX_MISFIT else (),
    )


def control_points(field: RayField, pinhole: Array, spacing: float) -> tuple[Spline, Spline]:
    """Return splines through the lines' points and directions at nodes over the picture, one of
    them on each edge. Their coefficients are the control points; those of the directions are unit
    vectors.
    """
    columns = _nodes(field.width, spacing)
    rows = _nodes(field.height, spacing)
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    origins, directions = lines(field, pinhole, pixels.reshape(-1, 2))
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


def misfit(
    field: RayField, pinhole: Array, points: Spline, directions: Spline
) -> tuple[float, float]:
    """Return the misfit in px of the undistorted picture at CHECK_DEPTH, RMS and at worst, midway
    between the nodes where the camera sees.
    """
    pixels = np.stack(
        np.meshgrid(midpoints(points.nodes_x), midpoints(points.nodes_y)), -1
    ).reshape(-1, 2)
    pixels = pixels[field.sees(pixels[:, 0], pixels[:, 1], np.inf)]
    exact = _points_at_check_depth(*lines(field, pinhole, pixels))
    fitted = _points_at_check_depth(points.at(pixels)[0], directions.at(pixels)[0])
    error = np.linalg.norm((exact - fitted) * pinhole[:2] / CHECK_DEPTH, axis=-1)
    return float(np.sqrt((error**2).mean())), float(error.max())


def _points_at_check_depth(origins: Array, directions: Array) -> Array:
    """Return (N, 2) m, x and y where the lines pass the plane z = CHECK_DEPTH."""
    slopes = directions[:, :2] / directions[:, 2:]
    return np.asarray(origins[:, :2] + slopes * (CHECK_DEPTH - origins[:, 2:]))


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
