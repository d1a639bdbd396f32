"""Write DepthAI's warp mesh of one depth, for StereoDepth.loadMeshFiles of a Luxonis camera, or for
its Warp node.

mesh_Zm_XxY.calib holds 32-bit floats: y and x in px of the camera's picture, for every X-th column
and Y-th row of the straight one, row by row, with one more of each beyond the last. X and Y are the
largest numbers up to 16 that divide the picture's width and height. setMeshStep(X, Y) sets them on
the device, which interpolates linearly between the points.

Source: include/depthai/pipeline/node/StereoDepth.hpp of depthai-core. loadMeshFiles and setMeshStep
give the order and the number of points. useHomographyRectification says that they mean what
cv2.initUndistortRectifyMap returns.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.export.export import ExportedFiles, ExportRequest, limit_remarks
from calib.io.file_set import FileSet
from calib.undistortion.ray_field import RayField

MAX_STEP = 16
"""px, the device's default."""


def export(request: ExportRequest) -> ExportedFiles:
    field = request.calibration.ray_field()
    written: list[Path] = []
    remarks: list[str] = []
    for depth, depth_name in request.each_depth():
        path, remark = write_mesh(field, depth, request.files, depth_name)
        written.append(path)
        remarks.append(remark)
    return ExportedFiles(tuple(written), remarks=(*remarks, *limit_remarks(request.calibration)))


def write_mesh(field: RayField, depth: float, files: FileSet, depth_name: str) -> tuple[Path, str]:
    """Write the mesh of a depth in m, named `depth_name` in the file's name. Return its path, and
    what to set on the device.
    """
    step_x = mesh_step(field.width)
    step_y = mesh_step(field.height)
    points = mesh(field, depth, (step_x, step_y))
    rms, worst = mesh_misfit(field, depth, points)
    name = f"mesh_{depth_name}m_{mesh_name(field.width, field.height)}.calib"
    path = files.write(name, points[..., ::-1].tobytes())
    remark = (
        f"setMeshStep({step_x}, {step_y}); between the points it is off by {rms:.4f} px RMS,"
        f" {worst:.4f} px at worst, at {depth:g} m."
    )
    return path, remark


def mesh_name(width: int, height: int) -> str:
    """Return what the file's name says of the mesh of a picture of this size in px."""
    return f"{mesh_step(width)}x{mesh_step(height)}"


def mesh_step(size: int) -> int:
    """Return the largest step up to MAX_STEP that divides a side of this many px."""
    return next(step for step in range(MAX_STEP, 0, -1) if size % step == 0)


def mesh(field: RayField, depth: float, steps: tuple[int, int]) -> NDArray[np.float32]:
    """Return (h, w, 2) px x and y in the camera's picture; where the camera does not see, the
    smooth continuation, or -1 where there is none.
    """
    step_x, step_y = steps
    columns = np.arange(0, field.width + step_x, step_x, dtype=np.float64)
    rows = np.arange(0, field.height + step_y, step_y, dtype=np.float64)
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    distorted, _ = field.distort_pixels(pixels.reshape(-1, 2), depth)
    return np.where(np.isfinite(distorted), distorted, -1.0).astype("<f4").reshape(pixels.shape)


def mesh_misfit(field: RayField, depth: float, points: NDArray[np.float32]) -> tuple[float, float]:
    """Return the misfit midway between the points where the camera sees, px, RMS and at worst."""
    depth_map = field.map_at(depth)
    exact = np.dstack([depth_map.x, depth_map.y])
    step_y = exact.shape[0] // (points.shape[0] - 1)
    step_x = exact.shape[1] // (points.shape[1] - 1)
    first_row = step_y // 2
    first_column = step_x // 2
    expected = exact[first_row::step_y, first_column::step_x]
    valid = depth_map.valid[first_row::step_y, first_column::step_x]
    interpolated = _between(points, first_row / step_y, first_column / step_x)
    error = np.linalg.norm(interpolated - expected, axis=-1)[valid]
    return float(np.sqrt((error**2).mean())), float(error.max(initial=0.0))


def _between(points: NDArray[np.float32], below: float, right: float) -> NDArray[np.float32]:
    """Interpolate linearly, at these fractions of a step below and to the right of each point."""
    rows = points[:-1] * (1 - below) + points[1:] * below
    return np.asarray(rows[:, :-1] * (1 - right) + rows[:, 1:] * right)
