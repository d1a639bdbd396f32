"""Write a .cameramodel of mrcal.

Its extrinsics contain the shift of the centre, so the reference frame is the calibration's camera
frame.
"""

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "camera_{}m.cameramodel", cameramodel)


def cameramodel(model: CentralModel) -> str:
    """Return the file's text, a Python literal."""
    content = {
        "lensmodel": f"LENSMODEL_{model.lens.name}",
        "intrinsics": [*model.focal, *model.principal, *model.distortion],
        "extrinsics": [0.0, 0.0, 0.0, *(0.0 - metres for metres in model.centre)],  # rt_fromref
        "imagersize": [model.width, model.height],
    }
    lines = "".join(f"    {key!r}: {value!r},\n" for key, value in content.items())
    return f"{model.commented()}{{\n{lines}}}\n"
