"""mrcal: a .cameramodel.

Its extrinsics carry the shift of the centre, so the reference frame is the calibration's camera
frame.
"""

from calib.export.central import CentralModel
from calib.export.export import Export, Exported, export_central


def export(wanted: Export) -> Exported:
    return export_central(wanted, "camera_{}m.cameramodel", cameramodel)


def cameramodel(model: CentralModel) -> str:
    """The file's text, a Python literal."""
    content = {
        "lensmodel": f"LENSMODEL_{model.lens.name}",
        "intrinsics": [*model.focal, *model.principal, *model.distortion],
        "extrinsics": [0.0, 0.0, 0.0, *(0.0 - metres for metres in model.centre)],  # rt_fromref
        "imagersize": [model.width, model.height],
    }
    lines = "".join(f"    {key!r}: {value!r},\n" for key, value in content.items())
    return f"{model.commented()}{{\n{lines}}}\n"
