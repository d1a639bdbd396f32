"""Write a ray image: the origin and the direction of every pixel's ray, for ray tracers and
renderers that take their rays as an array.

ray_image.npy, or ray_image_opengl.npy, is (height, width, 2, 3) float32. [v, u, 0] is the point in
m where the ray of the pixel in column u and row v leaves the cover; [v, u, 1] is the unit
direction; both are NaN where no ray leaves the cover. They are in the calibration's camera frame, x
right, y down, z forward (opencv), or in that frame after half a turn about x: x right, y up, z
backward (opengl).
"""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.export.export import ExportedFiles, ExportRequest
from calib.progress import Progress

BATCH_ROWS = 32
"""Rows of the picture that are traced at once."""
AXIS_SIGNS = {"opencv": (1, 1, 1), "opengl": (1, -1, -1)}
"""The factor of each axis."""


def export(request: ExportRequest) -> ExportedFiles:
    image = ray_image(request.calibration, request.axes, request.progress)
    name = "ray_image.npy" if request.axes == "opencv" else f"ray_image_{request.axes}.npy"
    content = BytesIO()
    np.save(content, image, allow_pickle=False)
    return ExportedFiles((request.files.write(name, content.getbuffer()),))


def ray_image(calibration: Calibration, axes: str, progress: Progress) -> NDArray[np.float32]:
    """Return (height, width, 2, 3) origins in m and unit directions; `axes` is one of
    formats.AXES.
    """
    width, height = calibration.camera.width, calibration.camera.height
    image = np.empty((height, width, 2, 3), np.float32)
    columns = np.arange(width, dtype=np.float64)
    advance = progress.task("Rays", height)
    for first in range(0, height, BATCH_ROWS):
        lines = np.arange(first, min(first + BATCH_ROWS, height), dtype=np.float64)
        pixels = np.stack(np.meshgrid(columns, lines), -1).reshape(-1, 2)
        rays = np.stack(calibration.rays(pixels), 1) * AXIS_SIGNS[axes]
        image[first : first + len(lines)] = rays.reshape(len(lines), width, 2, 3)
        advance(first + len(lines), "")
    return image
