"""The non-central generic camera model of Schöps et al.: a line for every pixel, by cubic B-splines
over the picture, for every depth.

A grid of control points spans the picture: the second and the last but one of a row stand at its
edges, so that every pixel lies between four of them each way. One grid has points on the lines, in
m, another unit directions, which are normalised again between them; as the control points are unit
vectors themselves, they are found by iteration. Pixels count from the corner of the picture. Where
no ray leaves the cover the lines are continued smoothly. They go wherever a wide lens sees, behind
the camera, too.

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
from calib.export.export import Export, Exported
from calib.undistortion.grids import all_corners, inner, middles
from calib.undistortion.ray_field import RayField
from calib.undistortion.spline import Spline

Array = NDArray[np.float64]

SPACINGS = (64, 32, 16, 8)
"""px between control points, the first that is fine enough."""
CLOSE = 0.005
"""px: the misfit, at worst, that is."""
NEAR = 0.1
"""m: the depth where the misfit is measured; farther away it is smaller."""
ROUNDS = 20
"""Of the iteration. Each leaves about a tenth of the error, or less."""


def export(wanted: Export) -> Exported:
    intrinsics = wanted.calibration.camera.intrinsics
    assert intrinsics
    pinhole = np.array([getattr(intrinsics, name).value for name in ("fx", "fy", "cx", "cy")])
    field = wanted.calibration.ray_field()
    if not field.valid.any():
        raise InputError("No ray of this camera leaves its cover: check the cover's numbers.")
    wide = wanted.calibration.model()[0].lens.wide
    traced = WideLines(wanted.calibration) if wide else PinholeLines(field, pinhole)
    advance = wanted.progress.task("Lines", len(SPACINGS))
    for done, spacing in enumerate(SPACINGS, start=1):
        points, directions = control_points(field, traced, spacing)
        rms, worst = misfit(pinhole, traced, points, directions)
        advance(done, f"{spacing} px")
        if worst < CLOSE:
            break
    stated = f"Misfit over the image: {rms:.4f} px RMS, {worst:.4f} px at worst, at {NEAR:g} m."
    text = camera_yaml(field, points.coefficients, directions.coefficients, stated)
    return Exported(
        (wanted.files.write("intrinsics0.yaml", text),), remarks=(stated,) if worst >= CLOSE else ()
    )


class Lines(Protocol):
    """The lines of pixels, as they are known."""

    def at(self, pixels: Array) -> tuple[Array, Array]:
        """(N, 3) m on the lines of (N, 2) px, and their (N, 3) unit directions; a smooth
        continuation where the camera does not see.
        """
        ...

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        """(h - 1, w - 1) whether the camera sees what lies midway between (w,) columns and (h,)
        rows.
        """
        ...


@dataclass(frozen=True, slots=True)
class PinholeLines:
    """The lines that an undistorted picture holds, by the field of rays."""

    field: RayField
    pinhole: Array
    """(4,) px: focal lengths and principal point."""

    def at(self, pixels: Array) -> tuple[Array, Array]:
        return lines(self.field, self.pinhole, pixels)

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        return self.field.sees(*np.meshgrid(middles(columns), middles(rows)), np.inf)


@dataclass(frozen=True, slots=True)
class WideLines:
    """The lines of a wide lens, as they are traced; their points are the nearest to the pinhole.
    No spline follows the lens next to where its formula ends: that does not count as visible.
    """

    calibration: Calibration

    def at(self, pixels: Array) -> tuple[Array, Array]:
        origins, directions = self.calibration.rays(pixels)
        valid = np.isfinite(directions).all(-1)
        nearest = np.flatnonzero(valid)[KDTree(pixels[valid]).query(pixels)[1]]
        origins, directions = origins[nearest], directions[nearest]
        return origins - (origins * directions).sum(-1, keepdims=True) * directions, directions

    def visible(self, columns: Array, rows: Array) -> NDArray[np.bool_]:
        pixels = np.stack(np.meshgrid(columns, rows), -1)
        _, directions = self.calibration.rays(pixels.reshape(-1, 2))
        valid = np.isfinite(directions[:, 0]).reshape(pixels.shape[:2])
        return inner(all_corners(valid))


def control_points(field: RayField, traced: Lines, spacing: float) -> tuple[Spline, Spline]:
    """Splines through the lines' points and directions at nodes over the picture, one of them on
    each edge; their coefficients are the control points, which of the directions are unit vectors.
    """
    columns, rows = (
        np.linspace(-0.5, size - 0.5, max(6, int(np.ceil(size / spacing)) + 1))
        for size in (field.width, field.height)
    )
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    origin, direction = (
        part.reshape(*pixels.shape[:2], 3) for part in traced.at(pixels.reshape(-1, 2))
    )
    aim = direction
    for _ in range(ROUNDS):
        fitted = _unit_coefficients(Spline.through(columns, rows, aim))
        reached = fitted.at(pixels.reshape(-1, 2))[0].reshape(direction.shape)
        aim = aim + direction - reached / np.linalg.norm(reached, axis=-1, keepdims=True)
    return Spline.through(columns, rows, origin), fitted


def lines(field: RayField, pinhole: Array, pixels: Array) -> tuple[Array, Array]:
    """(N, 3) m where the lines of (N, 2) px pass the plane z = 0 through the pinhole, and their (N,
    3) unit directions.
    """
    focal, centre = pinhole[:2], pinhole[2:]
    far = field.undistorted(pixels, np.inf)
    parallax = field.undistorted(pixels, 1.0) - far
    zero, one = np.zeros((len(pixels), 1)), np.ones((len(pixels), 1))
    towards = np.concatenate([(far - centre) / focal, one], -1)
    return np.concatenate([parallax / focal, zero], -1), towards / np.linalg.norm(
        towards, axis=-1, keepdims=True
    )


def misfit(
    pinhole: Array, traced: Lines, points: Spline, directions: Spline
) -> tuple[float, float]:
    """px, RMS and at worst, midway between the nodes, where the camera sees: how far a line passes
    what its pixel sees NEAR away, as a camera of this focal length would see it that looks there.
    """
    pixels = np.stack(np.meshgrid(middles(points.nodes_x), middles(points.nodes_y)), -1).reshape(
        -1, 2
    )
    pixels = pixels[traced.visible(points.nodes_x, points.nodes_y).ravel()]
    origin, towards = traced.at(pixels)
    seen = origin + NEAR * towards
    stated = directions.at(pixels)[0]
    stated = stated / np.linalg.norm(stated, axis=-1, keepdims=True)
    off = (
        pinhole[:2].mean()
        / NEAR
        * np.linalg.norm(np.cross(seen - points.at(pixels)[0], stated), axis=-1)
    )
    return float(np.sqrt((off**2).mean())), float(off.max())


def camera_yaml(field: RayField, points: Array, directions: Array, stated: str) -> str:
    """The file's text, of (h, w, 3) control points each.

    Its readers want every key on one line, and the sizes first.
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
    about = (
        "# Lines of a camera behind a cover, by Refracal. The frame is the calibration's camera"
        " frame.\n"
    )
    return about + f"# {stated}\n" + "".join(f"{key} : {value}\n" for key, value in keys.items())


def _unit_coefficients(spline: Spline) -> Spline:
    length = np.linalg.norm(spline.coefficients, axis=-1, keepdims=True)
    return replace(spline, coefficients=spline.coefficients / length)
