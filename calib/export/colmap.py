"""Write COLMAP's cameras.txt of one camera. COLMAP's pixel (0, 0) is the corner of the top-left
pixel, half a pixel before its centre.

COLMAP's poses are those of the shifted centre. A comment in the file says what to add to a pose of
the calibration's camera frame, and to a rig's.
"""

import numpy as np

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "cameras_{}m.txt", cameras_txt)


def cameras_txt(model: CentralModel) -> str:
    """Return the file's text."""
    x, y, z = (0.0 - np.array(model.centre)).tolist()
    comment = (
        "# TX TY TZ of a pose of the calibration's camera frame, and cam_from_rig of that frame as"
        f" the rig: add {x!r} {y!r} {z!r}\n"
    )
    return (
        f"{model.commented()}{comment * any(model.centre)}# CAMERA_ID, MODEL, WIDTH, HEIGHT,"
        f" PARAMS[]\n# Number of cameras: 1\n{camera_line(model, 1)}\n"
    )


def camera_line(model: CentralModel, number: int) -> str:
    """Return the line of cameras.txt for the camera with this CAMERA_ID."""
    parameters = map(repr, camera_parameters(model))
    return " ".join(
        [str(number), model.lens.name, str(model.width), str(model.height), *parameters]
    )


def camera_parameters(model: CentralModel) -> list[float]:
    """Return COLMAP's parameters of the camera, px."""
    cx, cy = model.principal
    return [*model.focal, cx + 0.5, cy + 0.5, *model.distortion]
