"""Ray image: where the ray of every pixel starts and where it goes, for ray tracers and renderers
that take their rays as an array.

ray_image.npy, or ray_image_opengl.npy, is (height, width, 2, 3) float32: [v, u, 0] is the point in
m where the ray of the pixel in column u and row v leaves the cover, [v, u, 1] the unit direction;
NaN where none leaves it. Both are in the calibration's camera frame: x right, y down, z forward
(opencv), or that turned by half a turn about x: x right, y up, z backward (opengl).
"""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.export.export import Export, Exported
from calib.progress import Progress

ROWS = 32
"""Of the picture, traced at once."""
TURNS = {"opencv": (1, 1, 1), "opengl": (1, -1, -1)}
"""What each axis is multiplied by."""


def export(wanted: Export) -> Exported:
    image = ray_image(wanted.calibration, wanted.axes, wanted.progress)
    name = "ray_image.npy" if wanted.axes == "opencv" else f"ray_image_{wanted.axes}.npy"
    content = BytesIO()
    np.save(content, image, allow_pickle=False)
    return Exported((wanted.files.write(name, content.getbuffer()),))


def ray_image(calibration: Calibration, axes: str, progress: Progress) -> NDArray[np.float32]:
    """(height, width, 2, 3) origins in m and unit directions; `axes` as formats.AXES has them."""
    width, height = calibration.camera.width, calibration.camera.height
    image = np.empty((height, width, 2, 3), np.float32)
    columns = np.arange(width, dtype=np.float64)
    advance = progress.task("Rays", height)
    for first in range(0, height, ROWS):
        lines = np.arange(first, min(first + ROWS, height), dtype=np.float64)
        pixels = np.stack(np.meshgrid(columns, lines), -1).reshape(-1, 2)
        rays = np.stack(calibration.rays(pixels), 1) * TURNS[axes]
        image[first : first + len(lines)] = rays.reshape(len(lines), width, 2, 3)
        advance(first + len(lines), "")
    return image
