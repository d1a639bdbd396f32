"""Write the `rays` of gsplat's rasterize_to_pixels_eval3d: (1, height, width, 6) float32, the point
where each pixel's ray leaves the cover, in m, and its unit direction.

They are in the calibration's camera frame, x right, y down, z forward, so the world has to be, too;
turn both parts of them by a view's T_world_camera otherwise. A pixel whose ray does not leave the
cover has a direction of zero.
"""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from calib.export.export import ExportedFiles, ExportRequest
from calib.export.ray_image import ray_image

NAME = "gsplat_rays.npy"


def export(request: ExportRequest) -> ExportedFiles:
    rays = ray_image(request.calibration, "opencv", request.progress)
    valid: NDArray[np.bool_] = np.asarray(np.isfinite(rays).all((2, 3)))
    content = BytesIO()
    flat = np.where(valid[..., None, None], rays, 0).reshape(1, *valid.shape, 6)
    np.save(content, flat.astype(np.float32), allow_pickle=False)
    return ExportedFiles((request.files.write(NAME, content.getbuffer()),))
