"""Write the windshield model of NVIDIA's NCore and gsplat: a camera behind a windshield, with
reference_poly, horizontal_poly, vertical_poly and their inverses.

ncore.data.decode_camera_model_parameters reads the file's JSON; gsplat's
BivariateWindshieldModelParameters have the same names. A pixel's centre is at 0.5 there.

Source: encode_camera_model_parameters in ncore/impl/data/types.py of NVIDIA NCore.
"""

import json

import numpy as np

from calib.calibration import Calibration
from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central
from calib.export.windshield_fit import TERMS, tangents_within_cover

ANGLE_MARGIN = 1.01
"""The angle where NCore's fisheye ends, over the largest angle of the picture's corners. A model
with an angle limit ends there instead.
"""


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(
        request, "windshield_{}m.json", lambda model: camera_model(model, request.calibration)
    )


def camera_model(model: CentralModel, calibration: Calibration) -> str:
    """Return the file's text."""
    coefficients = np.array(model.distortion)
    lens, polynomials = coefficients[: -4 * TERMS], coefficients[-4 * TERMS :].reshape(4, TERMS)
    horizontal, vertical, horizontal_inverse, vertical_inverse = polynomials.tolist()
    shutter = calibration.camera.shutter
    content = {
        "resolution": [model.width, model.height],
        "shutter_type": "ROLLING_TOP_TO_BOTTOM" if shutter and shutter.rolling else "GLOBAL",
        "external_distortion_parameters": {
            "reference_poly": "FORWARD",
            "horizontal_poly": horizontal,
            "vertical_poly": vertical,
            "horizontal_poly_inverse": horizontal_inverse,
            "vertical_poly_inverse": vertical_inverse,
            "external_distortion_type": "bivariate-windshield",
        },
        "principal_point": [pixel + 0.5 for pixel in model.principal],
        "focal_length": list(model.focal),
        **(_fisheye(model, lens) if model.lens.fisheye else _pinhole(lens)),
    }
    document = {
        "camera_model_type": model.lens.name,
        "camera_model_parameters": content,
        "refracal": model.statement,
    }
    return json.dumps(document, indent=1) + "\n"


def _pinhole(lens: np.ndarray) -> dict[str, object]:
    radial, tangential, prism = lens[[0, 1, 4, 5, 6, 7]], lens[[2, 3]], lens[8:]
    return {
        "radial_coeffs": radial.tolist(),
        "tangential_coeffs": tangential.tolist(),
        "thin_prism_coeffs": prism.tolist(),
    }


def _fisheye(model: CentralModel, lens: np.ndarray) -> dict[str, object]:
    right, bottom = model.width - 0.5, model.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    parameters = np.array([*model.focal, *model.principal, *lens])
    slopes = np.linalg.norm(tangents_within_cover(corners, model.lens, parameters), axis=-1)
    max_angle = model.angle_limit
    if max_angle is None:
        max_angle = ANGLE_MARGIN * float(np.arctan(slopes.max()))
    return {"radial_coeffs": lens.tolist(), "max_angle": max_angle}
