"""Write the camera of nerfstudio's transforms.json, to which the frames are added.

Pixels count from the corner of the picture, as in COLMAP. Poses are those of the shifted centre.
"""

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central
from calib.io.json_text import json_text


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "transforms_{}m.json", transforms_json)


def transforms_json(model: CentralModel) -> str:
    """Return the file's text. Under `refracal` are the lines that other formats have as comments;
    nerfstudio ignores them.
    """
    cx, cy = model.principal
    names = ("k1", "k2", "k3", "k4") if model.lens.fisheye else ("k1", "k2", "p1", "p2", "k3")
    content = {
        "camera_model": model.lens.name,
        "w": model.width,
        "h": model.height,
        "fl_x": model.focal[0],
        "fl_y": model.focal[1],
        "cx": cx + 0.5,
        "cy": cy + 0.5,
        **dict(zip(names, model.distortion, strict=False)),
        "frames": [],
        "refracal": model.statement,
    }
    return json_text(content)
