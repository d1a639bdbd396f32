"""Kalibr: a camchain of one camera, pinhole with radtan or equidistant distortion."""

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
    return model.commented() + yaml.safe_dump({"cam0": camera}, sort_keys=False, default_flow_style=None, width=120)
