"""DepthAI: a warp mesh of one depth, for StereoDepth.loadMeshFiles of a Luxonis camera, or for its
Warp node.

mesh_Zm_XxY.calib holds 32-bit floats: y and x in px of the camera's picture, for every X-th column
and Y-th row of the straight one, row by row, with one more of each beyond the last. X and Y are the
largest up to 16 by which the picture's width and height can be divided: tell the device by
setMeshStep(X, Y). It interpolates between them linearly.

Source: include/depthai/pipeline/node/StereoDepth.hpp of depthai-core: the order and the count of
    points at loadMeshFiles and setMeshStep,
and at useHomographyRectification that they mean what cv2.initUndistortRectifyMap gives.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.export.export import Export, Exported, limits
from calib.io.file_set import FileSet
from calib.undistortion.ray_field import RayField

STEP = 16
"""px, as the device has it where it is not told."""


def export(wanted: Export) -> Exported:
    field = wanted.calibration.ray_field()
    written: list[Path] = []
    remarks: list[str] = []
    for depth, said in wanted.each_depth():
        path, remark = write_mesh(field, depth, wanted.files, said)
        written.append(path)
        remarks.append(remark)
    return Exported(tuple(written), remarks=(*remarks, *limits(wanted.calibration)))


def write_mesh(field: RayField, depth: float, files: FileSet, said: str) -> tuple[Path, str]:
    """Write the mesh of a depth in m, which the file's name gives as `said`; its path, and what to
    tell the device.
    """
    steps = mesh_step(field.width), mesh_step(field.height)
    points = mesh(field, depth, steps)
    rms, worst = misfit(field, depth, points)
    across, down = steps
    path = files.write(f"mesh_{said}m_{across}x{down}.calib", points[..., ::-1].tobytes())
    told = (
        f"setMeshStep({across}, {down}); between the points it is off by {rms:.4f} px RMS,"
        f" {worst:.4f} px at worst, at {depth:g} m."
    )
    return path, told


def mesh_step(size: int) -> int:
    """The largest up to STEP that a side of so many px can be divided by."""
    return next(step for step in range(STEP, 0, -1) if size % step == 0)


def mesh(field: RayField, depth: float, steps: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w, 2) px x and y in the camera's picture; where the camera does not see, the smooth
    continuation, or -1 where there is none.
    """
    sizes = field.width, field.height
    columns, rows = (
        np.arange(0, size + step, step, dtype=np.float64)
        for size, step in zip(sizes, steps, strict=True)
    )
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    found, _ = field.distorted(pixels.reshape(-1, 2), depth)
    return np.where(np.isfinite(found), found, -1.0).astype("<f4").reshape(pixels.shape)


def misfit(field: RayField, depth: float, points: NDArray[np.float32]) -> tuple[float, float]:
    """px, RMS and at worst, halfway between the points, where the camera sees."""
    made = field.map_at(depth)
    exact = np.dstack([made.x, made.y])
    down, across = exact.shape[0] // (points.shape[0] - 1), exact.shape[1] // (points.shape[1] - 1)
    first, second = down // 2, across // 2
    wanted, valid = (part[first::down, second::across] for part in (exact, made.valid))
    weights = first / down, second / across
    off = np.linalg.norm(_between(points, *weights) - wanted, axis=-1)[valid]
    return float(np.sqrt((off**2).mean())), float(off.max(initial=0.0))


def _between(points: NDArray[np.float32], below: float, right: float) -> NDArray[np.float32]:
    rows = points[:-1] * (1 - below) + points[1:] * below
    return np.asarray(rows[:, :-1] * (1 - right) + rows[:, 1:] * right)
