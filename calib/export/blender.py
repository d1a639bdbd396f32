"""Write a custom camera of Blender 5: an OSL shader and its two textures, the origin and the
direction of every pixel's ray.

The textures are 32-bit float TIFF of the picture's size, red, green and blue for x right, y up and
z ahead, in m. The alpha of ray_direction is 1 where a ray leaves the cover, else 0.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.export.beside import file_beside
from calib.export.export import ExportedFiles, ExportRequest
from calib.export.ray_image import ray_image

SHADER = "refracal_camera.osl"
AXIS_SIGNS = np.array([1.0, -1.0, 1.0])
"""The factor of each axis of the calibration's camera frame: y is up."""


def export(request: ExportRequest) -> ExportedFiles:
    rays = ray_image(request.calibration, "opencv", request.progress)
    valid: NDArray[np.bool_] = np.asarray(np.isfinite(rays).all((2, 3)))
    blender_rays = np.where(valid[..., None, None], rays * AXIS_SIGNS, 0.0)
    files = request.files
    return ExportedFiles(
        (
            files.write("ray_origin.tiff", _tiff(blender_rays[:, :, 0], valid)),
            files.write("ray_direction.tiff", _tiff(blender_rays[:, :, 1], valid)),
            files.write(SHADER, file_beside("blender_camera.txt")),
        )
    )


def _tiff(vectors: NDArray[np.floating], valid: NDArray[np.bool_]) -> bytes:
    """Return a TIFF of (h, w, 3) vectors with their (h, w) alpha."""
    pixels = np.dstack([vectors[..., ::-1], valid]).astype(np.float32)  # OpenCV's order
    return cv2.imencode(".tiff", pixels)[1].tobytes()
