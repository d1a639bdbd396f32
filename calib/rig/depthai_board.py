"""A rig as the calibration of a Luxonis board, for dai.CalibrationHandler(FILE) and
Device.setCalibration.

The cameras take the sockets in the order of SOCKETS: a pair those of the left and the right
camera. Each camera's extrinsics lead to the next one, as DepthAI's chain of sockets does. Lengths
are in cm. JSON has no comments: the key `refracal`, which DepthAI ignores, holds the statements on
the misfit.

Source: CalibrationHandler.cpp, common/EepromData.hpp, CameraInfo.hpp and Extrinsics.hpp of
depthai-core.
"""

from __future__ import annotations

import json

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.export.central import CentralModel
from calib.export.formats import ExportLens
from calib.rig.central_rig import CentralRig

DEPTHAI_LENSES = (
    ExportLens("perspective", 5),
    ExportLens("perspective", 8),
    ExportLens("perspective", 12),
    ExportLens("fisheye", 4, fisheye=True),
)
SOCKETS = (1, 2, 0, 3, 4, 5, 6, 7, 8, 9)
"""dai.CameraBoardSocket of the first camera, CAM_B (left), of the second, CAM_C (right), and of the
further ones, CAM_A and CAM_D to CAM_J.
"""
NO_SOCKET = -1
"""dai.CameraBoardSocket.AUTO, at the end of the chain."""
COEFFICIENTS = 14
"""The number of distortion coefficients on the device, also of a fisheye."""
VERSION = 7
"""The version of the device's calibration data."""
CENTIMETRES = 100.0
"""cm in a metre."""


def depthai_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return calibration_Zm.json."""
    names = tuple(rig.models)
    if len(names) > len(SOCKETS):
        raise InputError(
            f"A Luxonis board has {len(SOCKETS)} sockets, and the rig has {len(names)} cameras:"
            " choose kalibr."
        )
    sockets = dict(zip(names, SOCKETS, strict=False))
    cameras = []
    for name, following in zip(names, (*names[1:], None), strict=True):
        pose = np.eye(4)
        if following is not None:
            pose = rig.poses[following] @ np.linalg.inv(rig.poses[name])
        socket = NO_SOCKET if following is None else sockets[following]
        cameras.append([sockets[name], _camera(rig.models[name], pose, socket)])
    content = {
        "version": VERSION,
        "cameraData": cameras,
        "stereoEnableDistortionCorrection": True,
        "stereoUseSpecTranslation": False,
        **_stereo(rig),
        "refracal": list(rig.statements),
    }
    return {f"calibration_{depth}m.json": json.dumps(content, indent=2) + "\n"}


def _camera(model: CentralModel, pose: NDArray[np.float64], socket: int) -> dict[str, object]:
    """Return the entry of one camera, with the (4, 4) pose that leads to the camera of a socket."""
    shift = dict(zip("xyz", (CENTIMETRES * pose[:3, 3]).tolist(), strict=True))
    padding = [0.0] * (COEFFICIENTS - len(model.distortion))
    field = 2 * np.degrees(np.arctan(model.width / 2 / model.focal[0]))
    return {
        "cameraType": int(model.lens.fisheye),
        "width": model.width,
        "height": model.height,
        "specHfovDeg": float(field),
        "lensPosition": 0,
        "intrinsicMatrix": model.matrix.tolist(),
        "distortionCoeff": [*model.distortion, *padding],
        "extrinsics": {
            "rotationMatrix": pose[:3, :3].tolist(),
            "translation": shift,
            "specTranslation": shift,
            "toCameraSocket": socket,
        },
    }


def _stereo(rig: CentralRig) -> dict[str, object]:
    """Return the rectification of the first two cameras; nothing for a rig of one."""
    if len(rig.models) < 2:
        return {}
    first, second, *_ = rig.models
    left, right = rig.models[first], rig.models[second]
    pose = rig.poses[second]
    no_lens = np.zeros(4)  # the rotations do not depend on the lenses
    turns = cv2.stereoRectify(
        left.matrix,
        no_lens,
        right.matrix,
        no_lens,
        (left.width, left.height),
        np.ascontiguousarray(pose[:3, :3]),
        np.ascontiguousarray(pose[:3, 3:]),
    )
    return {
        "stereoRectificationData": {
            "leftCameraSocket": SOCKETS[0],
            "rightCameraSocket": SOCKETS[1],
            "rectifiedRotationLeft": np.asarray(turns[0]).tolist(),
            "rectifiedRotationRight": np.asarray(turns[1]).tolist(),
        }
    }
