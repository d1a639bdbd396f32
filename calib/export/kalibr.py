"""Kalibr: a camchain of one camera, pinhole with radtan or equidistant distortion.

A chain of one camera says of no frame but its own: a comment has the transform from the
calibration's.
"""

import yaml

from calib.export.central import CentralModel
from calib.export.export import Export, Exported, export_central


def export(wanted: Export) -> Exported:
    return export_central(wanted, "camchain_{}m.yaml", camchain)


def camchain(model: CentralModel) -> str:
    """The file's text."""
    camera = {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(model.distortion),
        "distortion_model": model.lens.name,
        "intrinsics": [*model.focal, *model.principal],
        "resolution": [model.width, model.height],
        "rostopic": "/cam0/image_raw",
    }
    x, y, z = (0.0 - metres for metres in model.centre)
    about = (
        "# To chain it, as in T_cam_imu or T_cn_cnm1, put on the left of a transform into the"
        f" calibration's camera frame:\n# [[1.0, 0.0, 0.0, {x!r}], [0.0, 1.0, 0.0, {y!r}], [0.0,"
        f" 0.0, 1.0, {z!r}], [0.0, 0.0, 0.0, 1.0]]\n"
    )
    chain = yaml.safe_dump({"cam0": camera}, sort_keys=False, default_flow_style=None, width=120)
    return model.commented() + about * any(model.centre) + chain
