"""The cover cut through its middle, as a drawing shows it from the side."""

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.optics.exposure import MIDDLE
from calib.session.parameter_names import CAMERA

POINTS = 61
"""Points of each surface."""

Array = NDArray[np.float64]


def cover_section(calibration: Calibration) -> tuple[Array, ...]:
    """Return where the rays of the picture's column through the principal point cross each surface
    of the cover, from the inside out.

    Returns:
        An (N, 2) array of m for each surface, z and y in the camera frame. Rays that do not reach
        the surface are left out. Empty without a cover.
    """
    path, values = calibration.model()
    rows = torch.linspace(-0.5, calibration.camera.height - 0.5, POINTS, dtype=torch.float64)
    columns = torch.full_like(rows, float(values[CAMERA.cx]))
    pixels = torch.stack([columns, rows], -1)
    surfaces = []
    for count in range(1, len(path.cover) + 1):
        rays = replace(path, cover=path.cover[:count]).trace(pixels, values, MIDDLE)
        arrived = rays.failure == 0
        points = rays.origin.stacked()[arrived]
        surfaces.append(points[:, [2, 1]].numpy())
    return tuple(surfaces)
