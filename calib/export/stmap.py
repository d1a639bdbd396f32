"""Write STMaps for compositing programs: red and green are the sampling place, from 0 to 1 from
left to right and, as is usual for them, from the bottom up.

Each depth has two. stmap_undistort turns a picture of the camera into the straight one.
stmap_redistort turns a straight picture, such as a render, into the one that the camera would see.
Alpha is 1 where the camera sees; elsewhere all channels are 0. The files are 32-bit float, TIFF or
OpenEXR.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.export.export import ExportedFiles, ExportRequest, limit_remarks
from calib.io.file_set import FileSet
from calib.undistortion.ray_field import RayField

Map = NDArray[np.float32]


def export(request: ExportRequest) -> ExportedFiles:
    field = request.calibration.ray_field()
    suffix = ".exr" if request.form.name == "stmap-exr" else ".tiff"
    return ExportedFiles(
        tuple(
            path
            for depth, name in request.each_depth()
            for path in write_stmaps(field, depth, request.files, name, suffix)
        ),
        remarks=limit_remarks(request.calibration),
    )


def write_stmaps(
    field: RayField, depth: float, files: FileSet, name: str, suffix: str
) -> list[Path]:
    """Write both maps of a depth in m. `name` is the depth in file names; `suffix` is .tiff or
    .exr.
    """
    encode = _exr if suffix == ".exr" else _tiff
    depth_map = field.map_at(depth)
    written = []
    for direction, pixels in (
        ("undistort", _normalised(depth_map.x, depth_map.y, depth_map.valid)),
        ("redistort", _redistortion(field, depth)),
    ):
        written.append(files.write(f"stmap_{direction}_{name}m{suffix}", encode(pixels)))
    return written


def _normalised(x: Map, y: Map, valid: NDArray[np.bool_]) -> Map:
    """Return (h, w, 4) red, green, blue, alpha from source px. (0, 0) px is a pixel's centre; (0,
    0) of an STMap is the picture's bottom left corner.
    """
    height, width = x.shape
    pixels = np.dstack(
        [(x + 0.5) / width, 1 - (y + 0.5) / height, np.zeros_like(x), np.ones_like(x)]
    ).astype(np.float32)
    pixels[~valid] = 0
    return pixels


def _redistortion(field: RayField, depth: float) -> Map:
    """Return the (h, w, 4) map from a straight picture to the camera's."""
    x = np.empty((field.height, field.width), np.float32)
    y = np.empty((field.height, field.width), np.float32)
    for rows, (strip_x, strip_y) in field.spline(depth).strips(field.width, field.height):
        x[rows] = strip_x
        y[rows] = strip_y
    columns, lines = np.meshgrid(
        np.arange(field.width, dtype=np.float64), np.arange(field.height, dtype=np.float64)
    )
    return _normalised(x, y, field.sees(columns, lines, depth))


def _tiff(pixels: Map) -> bytes:
    return cv2.imencode(".tiff", cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGRA))[1].tobytes()


def _exr(pixels: Map) -> bytes:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "map.exr"
        OpenEXR.File(header, {"RGBA": pixels}).write(str(path))
        return path.read_bytes()
