"""Write a .cameramodel of mrcal.

Its extrinsics contain the shift of the centre. Of one camera, the reference frame is the
calibration's camera frame.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "camera_{}m.cameramodel", cameramodel)


def cameramodel(model: CentralModel, pose: NDArray[np.float64] | None = None) -> str:
    """Return the file's text, a Python literal.

    Args:
        model: the camera.
        pose: (4, 4) from the reference frame to the model's. None: the reference frame is the
            calibration's camera frame.
    """
    if pose is None:
        rotation = [0.0, 0.0, 0.0]
        translation = [0.0 - metres for metres in model.centre]
    else:
        rotation = cv2.Rodrigues(pose[:3, :3])[0].ravel().tolist()
        translation = pose[:3, 3].tolist()
    content = {
        "lensmodel": f"LENSMODEL_{model.lens.name}",
        "intrinsics": [*model.focal, *model.principal, *model.distortion],
        "extrinsics": [*rotation, *translation],  # rt_cam_ref
        "imagersize": [model.width, model.height],
    }
    lines = "".join(f"    {key!r}: {value!r},\n" for key, value in content.items())
    return f"{model.commented()}{{\n{lines}}}\n"
