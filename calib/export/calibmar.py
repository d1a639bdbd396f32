"""Calibmar and COLMAP's fork for under water: a camera behind a flat port or a dome by the port's
own numbers, which hold at every depth.

FLATPORT has Nx, Ny, Nz, int_dist, int_thick, na, ng, nw: the window's unit normal, its inner face's
distance from the pinhole along that normal, the thickness, and the indices of air, glass and what
lies outside. DOMEPORT has Cx, Cy, Cz, int_radius, int_thick, na, ng, nw. Both are in the camera
frame, in m, and count pixels from the corner of the picture. Neither has a place for uneven glass:
that is left out.

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
from calib.export.central import CentralModel, best_central, uncovered
from calib.export.export import Export, Exported
from calib.export.lens_fit import as_intrinsics
from calib.export.sight import CHECKED
from calib.optics.dome import Dome
from calib.optics.flat import Flat
from calib.optics.rays import FLATTEST
from calib.optics.vector import Vector
from calib.session.cover import Cover
from calib.session.schema import Number

Array = NDArray[np.float64]

DEPTHS = (0.3, 0.5, 1.0, 3.0)
"""m: where the misfit is told of a calibration for all depths."""
AIR = 1.0
EXACT = 1e-3
"""px: a misfit below this is none."""
FLAT, DOME = "FLATPORT", "DOMEPORT"
KEYS = {
    FLAT: "Nx, Ny, Nz, int_dist, int_thick, na, ng, nw",
    DOME: "Cx, Cy, Cz, int_radius, int_thick, na, ng, nw",
}


@dataclass(frozen=True, slots=True)
class Port:
    """A housing's port, in the order of the parameters that both programs read."""

    name: str
    place: tuple[float, float, float]
    """The unit normal of a window, or m, a dome's centre."""
    reach: float
    """m, along the normal to the inner face, or a dome's inner radius."""
    thickness: float
    """m"""
    glass: float
    outside: float

    @property
    def parameters(self) -> tuple[float, ...]:
        return (*self.place, self.reach, self.thickness, AIR, self.glass, self.outside)

    @property
    def cover(self) -> Cover:
        """The same as a session describes it."""
        x, y, z = self.place
        if self.name == DOME:
            own = {"inner_radius": self.reach, "centre.x": x, "centre.y": y, "centre.z": z}
        else:
            sine = float(np.hypot(x, y))
            turn = np.arctan2(sine, z) / sine if sine else 1.0
            own = {"distance": self.reach / z, "tilt.x": -y * turn, "tilt.y": x * turn}
        numbers = own | {
            "thickness": self.thickness,
            "refractive_index": self.glass,
            "outside_index": self.outside,
        }
        return Cover(
            "dome" if self.name == DOME else "flat",
            {name: Number(float(value)) for name, value in numbers.items()},
        )


def export(wanted: Export) -> Exported:
    calibration = wanted.calibration
    port, bare = port_of(calibration), uncovered(calibration)
    camera = best_central(bare, 1.0, wanted.lenses)
    off = tuple(_misfits(calibration, _behind(bare, camera, port), wanted.depths or DEPTHS))
    path = wanted.files.write("calibmar.yaml", calibration_yaml(camera, port, off))
    return Exported((path,), remarks=off if any(not line.endswith("exact") for line in off) else ())


def port_of(calibration: Calibration) -> Port:
    """The port that stands before the camera, what the diagnosis found of it included.

    Raises:
        InputError: what stands there is neither a window nor a dome.
    """
    path, values = calibration.model()
    if not path.cover or not isinstance(path.cover[-1].surface, Flat | Dome):
        shape = calibration.cover.shape
        raise InputError(
            f"--format calibmar has flat and dome ports, and this cover is a {shape}: write"
            " --format generic, which holds all."
        )
    _, told = path.adjusted(torch.zeros((1, 2), dtype=torch.float64), values)
    inner, outer = path.cover
    thickness, glass, outside = (
        float(told[f"cover.{name}"]) for name in ("thickness", "refractive_index", "outside_index")
    )
    at = _numbers(inner.frame.at(told).leave(_point(0.0)))
    if isinstance(outer.surface, Dome):
        return Port(DOME, at, float(told["cover.inner_radius"]), thickness, glass, outside)
    normal = _numbers(inner.frame.at(told).turn(_point(1.0), back=True))
    return Port(FLAT, normal, float(np.dot(normal, at)), thickness, glass, outside)


def calibration_yaml(camera: CentralModel, port: Port, off: tuple[str, ...]) -> str:
    """The file's text, with the options of COLMAP's fork as a comment.

    Calibmar reads keys line by line.
    """
    cx, cy = camera.principal
    own = ", ".join(map(repr, (*camera.focal, cx + 0.5, cy + 0.5, *camera.distortion)))
    ports = ", ".join(map(repr, port.parameters))
    return "".join(
        f"{line}\n"
        for line in (
            "# A camera behind a port, by Refracal. Its frame is the calibration's camera frame.",
            *(f"# {line}" for line in off),
            (
                f"# COLMAP's fork: --ImageReader.camera_model {camera.lens.name}"
                f' --ImageReader.camera_params "{own}"'
            ),
            (
                f"#   --ImageReader.camera_refrac_model {port.name}"
                f' --ImageReader.camera_refrac_params "{ports}"'
            ),
            f"model: {camera.lens.name}",
            f"parameters: [{own}]",
            f"non_svp_model: {port.name}",
            f"# {KEYS[port.name]}",
            f"non_svp_parameters: [{ports}]",
            f"width: {camera.width}",
            f"height: {camera.height}",
        )
    )


def _behind(bare: Calibration, camera: CentralModel, port: Port) -> Calibration:
    """What the file says, as a calibration."""
    intrinsics = as_intrinsics(
        (*camera.focal, *camera.principal, *camera.distortion), camera.lens.fisheye
    )
    return replace(
        bare, camera=replace(bare.camera, intrinsics=intrinsics), cover=port.cover, effects=()
    )


def _misfits(calibration: Calibration, said: Calibration, depths: Sequence[float]) -> Iterator[str]:
    """How far what a pixel sees by the file is from what it sees by the calibration, in px of the
    undistorted picture.
    """
    k = calibration.camera.intrinsics
    assert k
    sizes = calibration.camera.width, calibration.camera.height
    axes = (np.linspace(0, size - 1, count) for size, count in zip(sizes, CHECKED, strict=True))
    pixels = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    if calibration.model()[0].lens.wide:
        pixels = pixels[calibration.ray_field().holds(pixels)]
    (from_, along), (other, beside) = (one.rays(pixels) for one in (calibration, said))
    for depth in depths:
        seen, stated = (
            o[:, :2]
            + d[:, :2]
            * ((depth - o[:, 2]) / np.where(d[:, 2] > FLATTEST, d[:, 2], np.nan))[:, None]
            for o, d in ((from_, along), (other, beside))
        )
        off = np.linalg.norm((seen - stated) * [k.fx.value / depth, k.fy.value / depth], axis=-1)
        off = off[np.isfinite(off)]
        rms, worst = float(np.sqrt((off**2).mean())), float(off.max())
        told = (
            "exact"
            if worst < EXACT
            else "what the port has no place for, an uneven glass say, is left out"
        )
        yield (
            f"Misfit over the image: {rms:.4f} px RMS, {worst:.4f} px at worst, at {depth:g} m:"
            f" {told}"
        )


def _point(z: float) -> Vector:
    return Vector(*(torch.tensor(value, dtype=torch.float64) for value in (0.0, 0.0, z)))


def _numbers(vector: Vector) -> tuple[float, float, float]:
    x, y, z = vector.stacked().reshape(-1).tolist()
    return x, y, z
