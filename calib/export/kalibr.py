"""Write Kalibr's camchain of one camera, a pinhole with radtan or equidistant distortion.

A chain of one camera has no frame but its own. A comment in the file gives the transform from the
calibration's frame.
"""

import numpy as np
import yaml

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "camchain_{}m.yaml", camchain)


def camchain(model: CentralModel) -> str:
    """Return the file's text."""
    camera = camera_entry(model, "/cam0/image_raw")
    x, y, z = (0.0 - np.array(model.centre)).tolist()
    comment = (
        "# To chain it, as in T_cam_imu or T_cn_cnm1, put on the left of a transform into the"
        f" calibration's camera frame:\n# [[1.0, 0.0, 0.0, {x!r}], [0.0, 1.0, 0.0, {y!r}], [0.0,"
        f" 0.0, 1.0, {z!r}], [0.0, 0.0, 0.0, 1.0]]\n"
    )
    chain = yaml.safe_dump({"cam0": camera}, sort_keys=False, default_flow_style=None, width=120)
    return model.commented() + comment * any(model.centre) + chain


def camera_entry(model: CentralModel, topic: str) -> dict[str, object]:
    """Return the entry of one camera, whose pictures come by a ROS topic."""
    return {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(model.distortion),
        "distortion_model": model.lens.name,
        "intrinsics": [*model.focal, *model.principal],
        "resolution": [model.width, model.height],
        "rostopic": topic,
    }
