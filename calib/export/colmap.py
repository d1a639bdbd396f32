"""COLMAP: cameras.txt of one camera. COLMAP's pixel (0, 0) is the corner of the top-left pixel, half a pixel before its centre."""

from calib.export.central import CentralModel
from calib.export.export import Export, Exported, export_central


def export(wanted: Export) -> Exported:
    return export_central(wanted, "cameras_{}m.txt", cameras_txt)


def cameras_txt(model: CentralModel) -> str:
    """The file's text."""
    cx, cy = model.principal
    parameters = (*model.focal, cx + 0.5, cy + 0.5, *model.distortion)
    line = " ".join(["1", model.lens.name, str(model.width), str(model.height), *map(repr, parameters)])
    return f"{model.commented()}# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n{line}\n"
