"""Write a camera for Calibmar and COLMAP's underwater fork: a camera behind a flat port or a dome,
by the port's own numbers, which are valid at every depth.

FLATPORT has Nx, Ny, Nz, int_dist, int_thick, na, ng, nw: the window's unit normal, the distance of
its inner face from the pinhole along that normal, the thickness, and the indices of air, glass and
the medium outside. DOMEPORT has Cx, Cy, Cz, int_radius, int_thick, na, ng, nw. Both are in the
camera frame, in m, and count pixels from the corner of the picture. Neither can represent uneven
glass, so that is left out.

Source: FlatPort and DomePort in src/colmap/sensor/models_refrac.h of COLMAP Underwater;
"Calibration Report" in Calibmar's documentation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError
from calib.export.central import CentralModel, best_central, remove_cover
from calib.export.export import ExportedFiles, ExportRequest
from calib.export.lens_fit import to_intrinsics
from calib.export.sampled_rays import CHECK_GRID
from calib.optics.exposure import MIDDLE
from calib.optics.rays import FLATTEST
from calib.optics.vector import Vector
from calib.session.cover import Cover
from calib.session.parameter_names import COVER
from calib.session.schema import Number
from calib.session.shapes.dome import DOME
from calib.session.shapes.flat import FLAT
from calib.session.shapes.registry import find_shape
from calib.session.shapes.shape import Shape

Array = NDArray[np.float64]

DEPTHS = (0.3, 0.5, 1.0, 3.0)
"""m: the depths at which the misfit is stated for a calibration that holds at all depths."""
AIR = 1.0
EXACT_LIMIT = 1e-3
"""px: a smaller misfit is called exact."""
KEYS = {
    FLAT.port: "Nx, Ny, Nz, int_dist, int_thick, na, ng, nw",
    DOME.port: "Cx, Cy, Cz, int_radius, int_thick, na, ng, nw",
}


@dataclass(frozen=True, slots=True)
class Port:
    """A housing's port, in the order of the parameters that both programs read."""

    shape: Shape
    """A window or a dome."""
    normal_or_centre: tuple[float, float, float]
    """A window's unit normal, or a dome's centre in m."""
    distance_or_radius: float
    """m, the distance along the normal to the inner face, or a dome's inner radius."""
    thickness: float
    """m"""
    glass_index: float
    outside_index: float

    @property
    def parameters(self) -> tuple[float, ...]:
        """The parameters in the order of the file."""
        return (
            *self.normal_or_centre,
            self.distance_or_radius,
            self.thickness,
            AIR,
            self.glass_index,
            self.outside_index,
        )

    @property
    def cover(self) -> Cover:
        """The port as a session describes it."""
        x, y, z = self.normal_or_centre
        if self.shape is DOME:
            shape_numbers = {
                "inner_radius": self.distance_or_radius,
                "centre.x": x,
                "centre.y": y,
                "centre.z": z,
            }
        else:
            # The tilt is the rotation vector that turns the optical axis onto the normal.
            sine = float(np.hypot(x, y))
            angle_over_sine = np.arctan2(sine, z) / sine if sine else 1.0
            shape_numbers = {
                "distance": self.distance_or_radius / z,  # along the optical axis
                "tilt.x": -y * angle_over_sine,
                "tilt.y": x * angle_over_sine,
            }
        numbers = shape_numbers | {
            "thickness": self.thickness,
            "refractive_index": self.glass_index,
            "outside_index": self.outside_index,
        }
        return Cover(
            self.shape.name,
            {name: Number(float(value)) for name, value in numbers.items()},
        )


def export(request: ExportRequest) -> ExportedFiles:
    """Write calibmar.yaml; remark on the misfit unless it is exact at every depth."""
    calibration = request.calibration
    port = port_of(calibration)
    bare = remove_cover(calibration)
    camera = best_central(bare, 1.0, request.lenses)
    exported = _exported_calibration(bare, camera, port)
    misfits = tuple(_misfits(calibration, exported, request.depths or DEPTHS))
    path = request.files.write("calibmar.yaml", calibration_yaml(camera, port, misfits))
    return ExportedFiles(
        (path,), remarks=misfits if any(not line.endswith("exact") for line in misfits) else ()
    )


def port_of(calibration: Calibration) -> Port:
    """Return the port in front of the camera, with the effects that the diagnosis found in it.

    Raises:
        InputError: the cover is neither a window nor a dome.
    """
    path, values = calibration.model()
    declared = find_shape(calibration.cover.shape)
    shape = FLAT if path.cover and not declared.has_glass else declared  # effects.flat_port
    if len(path.cover) > 2:
        raise InputError(
            "--format calibmar has ports of one layer of glass, and this cover has more: write"
            " --format generic, which holds every cover."
        )
    if not shape.port:
        raise InputError(
            f"--format calibmar has flat and dome ports, and this cover is a {shape.name}: write"
            " --format generic, which holds every shape."
        )
    _, adjusted = path.adjust_pixels(torch.zeros((1, 2), dtype=torch.float64), values, MIDDLE)
    inner = path.cover[0]
    thickness = float(adjusted[COVER.thickness()])
    glass_index = float(adjusted[COVER.refractive_index()])
    outside_index = float(adjusted[COVER.outside_index])
    pose = inner.frame.at(adjusted)
    origin = _components(pose.leave(_point_on_axis(0.0)))  # of the cover, in the camera frame
    if shape is DOME:
        radius = float(adjusted[COVER.of("inner_radius")])
        return Port(DOME, origin, radius, thickness, glass_index, outside_index)
    normal = _components(pose.turn(_point_on_axis(1.0), back=True))
    distance = float(np.dot(normal, origin))
    return Port(FLAT, normal, distance, thickness, glass_index, outside_index)


def calibration_yaml(camera: CentralModel, port: Port, misfits: tuple[str, ...]) -> str:
    """Return the file's text, with the options of COLMAP's fork as a comment.

    Calibmar reads keys line by line.
    """
    cx, cy = camera.principal
    camera_parameters = ", ".join(
        map(repr, (*camera.focal, cx + 0.5, cy + 0.5, *camera.distortion))
    )
    ports = ", ".join(map(repr, port.parameters))
    return "".join(
        f"{line}\n"
        for line in (
            "# A camera behind a port, by Refracal. Its frame is the calibration's camera frame.",
            *(f"# {line}" for line in misfits),
            (
                f"# COLMAP's fork: --ImageReader.camera_model {camera.lens.name}"
                f' --ImageReader.camera_params "{camera_parameters}"'
            ),
            (
                f"#   --ImageReader.camera_refrac_model {port.shape.port}"
                f' --ImageReader.camera_refrac_params "{ports}"'
            ),
            f"model: {camera.lens.name}",
            f"parameters: [{camera_parameters}]",
            f"non_svp_model: {port.shape.port}",
            f"# {KEYS[port.shape.port]}",
            f"non_svp_parameters: [{ports}]",
            f"width: {camera.width}",
            f"height: {camera.height}",
        )
    )


def _exported_calibration(bare: Calibration, camera: CentralModel, port: Port) -> Calibration:
    """Return the file's contents as a calibration."""
    intrinsics = to_intrinsics(
        (*camera.focal, *camera.principal, *camera.distortion), camera.lens.fisheye
    )
    return replace(
        bare, camera=replace(bare.camera, intrinsics=intrinsics), cover=port.cover, effects=()
    )


def _misfits(
    calibration: Calibration, exported: Calibration, depths: Sequence[float]
) -> Iterator[str]:
    """Yield the distance, in px of the undistorted picture, between the points that a pixel sees by
    the file and by the calibration.
    """
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    columns = np.linspace(0, calibration.camera.width - 1, CHECK_GRID[0])
    rows = np.linspace(0, calibration.camera.height - 1, CHECK_GRID[1])
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    if calibration.model()[0].lens.wide:
        pixels = pixels[calibration.ray_field().holds(pixels)]
    exact_rays = calibration.rays(pixels)
    exported_rays = exported.rays(pixels)
    for depth in depths:
        difference = _points_at(depth, *exact_rays) - _points_at(depth, *exported_rays)
        px_per_m = np.array([intrinsics.fx.value, intrinsics.fy.value]) / depth
        error = np.linalg.norm(difference * px_per_m, axis=-1)
        error = error[np.isfinite(error)]
        rms = float(np.sqrt((error**2).mean()))
        worst = float(error.max())
        verdict = (
            "exact"
            if worst < EXACT_LIMIT
            else "the port cannot represent the rest, such as uneven glass, which is left out"
        )
        yield (
            f"Misfit over the image: {rms:.4f} px RMS, {worst:.4f} px at worst, at {depth:g} m:"
            f" {verdict}"
        )


def _points_at(depth: float, origins: Array, directions: Array) -> Array:
    """Return (N, 2) m, x and y where the rays pass the plane z = depth; NaN for rays that do not go
    forward.
    """
    forward = np.where(directions[:, 2] > FLATTEST, directions[:, 2], np.nan)
    steps = (depth - origins[:, 2]) / forward
    return np.asarray(origins[:, :2] + directions[:, :2] * steps[:, None])


def _point_on_axis(z: float) -> Vector:
    """Return the point (0, 0, z) of a cover's frame."""
    zero = torch.tensor(0.0, dtype=torch.float64)
    return Vector(zero, zero, torch.tensor(z, dtype=torch.float64))


def _components(vector: Vector) -> tuple[float, float, float]:
    """Return the three components of one vector."""
    x, y, z = vector.stacked().reshape(-1).tolist()
    return x, y, z
