"""STMaps for compositing programs: red and green say where to sample, from 0 to 1 across and, as
those count, from the bottom up.

Two for each depth: stmap_undistort takes a picture of the camera to the straight one,
    stmap_redistort takes a straight picture (a
render, say) to what the camera would see. Alpha is 1 where the camera sees; elsewhere all is 0.
32-bit float, as TIFF or OpenEXR.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.export.export import Export, Exported, limits
from calib.io.file_set import FileSet
from calib.undistortion.ray_field import RayField

Map = NDArray[np.float32]


def export(wanted: Export) -> Exported:
    field, suffix = (
        wanted.calibration.ray_field(),
        (".exr" if wanted.form.name == "stmap-exr" else ".tiff"),
    )
    return Exported(
        tuple(
            path
            for depth, name in wanted.each_depth()
            for path in write_stmaps(field, depth, wanted.files, name, suffix)
        ),
        remarks=limits(wanted.calibration),
    )


def write_stmaps(
    field: RayField, depth: float, files: FileSet, name: str, suffix: str
) -> list[Path]:
    """Write both maps of a depth in m, which file names give as `name`; `suffix` is .tiff or
    .exr.
    """
    encode = _exr if suffix == ".exr" else _tiff
    made = field.map_at(depth)
    written = []
    for direction, pixels in (
        ("undistort", _normalised(made.x, made.y, made.valid)),
        ("redistort", _redistorting(field, depth)),
    ):
        written.append(files.write(f"stmap_{direction}_{name}m{suffix}", encode(pixels)))
    return written


def _normalised(x: Map, y: Map, valid: NDArray[np.bool_]) -> Map:
    """(h, w, 4) red, green, blue, alpha of source px; pixel (0, 0) is a centre, and (0, 0) of an
    STMap the picture's bottom left corner.
    """
    height, width = x.shape
    pixels = np.dstack(
        [(x + 0.5) / width, 1 - (y + 0.5) / height, np.zeros_like(x), np.ones_like(x)]
    ).astype(np.float32)
    pixels[~valid] = 0
    return pixels


def _redistorting(field: RayField, depth: float) -> Map:
    x, y = (np.empty((field.height, field.width), np.float32) for _ in range(2))
    for rows, (across, down) in field.spline(depth).strips(field.width, field.height):
        x[rows], y[rows] = across, down
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
