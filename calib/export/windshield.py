"""NVIDIA's NCore and gsplat: a camera behind a windshield, with reference_poly, horizontal_poly,
vertical_poly and their inverses.

The file is what ncore.data.decode_camera_model_parameters takes of a JSON file; gsplat's
BivariateWindshieldModelParameters have the same names. A pixel's centre is at 0.5 there.

Source: encode_camera_model_parameters in ncore/impl/data/types.py of NVIDIA NCore.
"""

import json

import numpy as np

from calib.calibration import Calibration
from calib.export.central import CentralModel
from calib.export.export import Export, Exported, export_central
from calib.export.windshield_fit import TERMS, within_cover

WIDER = 1.01
"""Than what the picture's corners see: where NCore's fisheye ends, unless it ends before them."""


def export(wanted: Export) -> Exported:
    return export_central(
        wanted, "windshield_{}m.json", lambda model: camera_model(model, wanted.calibration)
    )


def camera_model(model: CentralModel, calibration: Calibration) -> str:
    """The file's text."""
    coefficients = np.array(model.distortion)
    lens, polynomials = coefficients[: -4 * TERMS], coefficients[-4 * TERMS :].reshape(4, TERMS)
    horizontal, vertical, horizontal_back, vertical_back = polynomials.tolist()
    shutter = calibration.camera.shutter
    content = {
        "resolution": [model.width, model.height],
        "shutter_type": "ROLLING_TOP_TO_BOTTOM" if shutter and shutter.rolling else "GLOBAL",
        "external_distortion_parameters": {
            "reference_poly": "FORWARD",
            "horizontal_poly": horizontal,
            "vertical_poly": vertical,
            "horizontal_poly_inverse": horizontal_back,
            "vertical_poly_inverse": vertical_back,
            "external_distortion_type": "bivariate-windshield",
        },
        "principal_point": [pixel + 0.5 for pixel in model.principal],
        "focal_length": list(model.focal),
        **(_fisheye(model, lens) if model.lens.fisheye else _pinhole(lens)),
    }
    said = {
        "camera_model_type": model.lens.name,
        "camera_model_parameters": content,
        "refracal": model.statement,
    }
    return json.dumps(said, indent=1) + "\n"


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
    own = np.array([*model.focal, *model.principal, *lens])
    angle = float(np.arctan(np.linalg.norm(within_cover(corners, model.lens, own), axis=-1).max()))
    widest = WIDER * angle if model.limit is None else model.limit
    return {"radial_coeffs": lens.tolist(), "max_angle": widest}
