"""Write PhotonVision's calibration file of one resolution, which its page of cameras imports.

Source: CameraCalibrationCoefficients and JsonMatOfDouble of PhotonVision; distCoeffs are OpenCV's,
and PhotonVision reads eight.
"""

import numpy as np

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central
from calib.io.json_text import json_text

CV_64F = 6
"""OpenCV's number of the type of the matrices."""
COEFFICIENTS = 8


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "photonvision_{}m.json", calibration_json)


def calibration_json(model: CentralModel) -> str:
    """Return the file's text. Under `refracal` are the lines that other formats have as comments;
    PhotonVision ignores them.
    """
    distortion = [*model.distortion, *[0.0] * (COEFFICIENTS - len(model.distortion))]
    content = {
        "resolution": {"width": float(model.width), "height": float(model.height)},
        "cameraIntrinsics": _matrix(model.matrix.tolist()),
        "distCoeffs": _matrix([distortion]),
        "calobjectWarp": [0.0, 0.0],
        "observations": [],
        "calobjectSize": {"width": 0.0, "height": 0.0},
        "calobjectSpacing": 0.0,
        "lensmodel": "LENSMODEL_OPENCV",
        "refracal": model.statement,
    }
    return json_text(content)


def _matrix(rows: list[list[float]]) -> dict[str, object]:
    return {
        "rows": len(rows),
        "cols": len(rows[0]),
        "type": CV_64F,
        "data": np.ravel(rows).tolist(),
    }
