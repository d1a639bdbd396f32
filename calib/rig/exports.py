"""The formats of a rig for other programs: each camera as the central one that is nearest to it at
a depth, and the transforms between them. Every file says how far each model is off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import yaml

from calib.export.formats import COLMAP, MRCAL, ROS, ExportLens
from calib.export.kalibr import camera_entry
from calib.export.mrcal import cameramodel
from calib.export.ros import camera_content
from calib.rig.caliscope_array import CALISCOPE_LENSES, caliscope_files
from calib.rig.central_rig import CentralRig, rectified
from calib.rig.colmap_model import colmap_files
from calib.rig.depthai_board import DEPTHAI_LENSES, depthai_files

STEREO_LENSES = (
    ExportLens("opencv", 5),
    ExportLens("opencv", 8),
    ExportLens("opencv", 12),
)
"""The lenses that cv2.stereoRectify takes."""
KALIBR_LENSES = (ExportLens("radtan", 4), ExportLens("equidistant", 4, fisheye=True))


@dataclass(frozen=True, slots=True)
class RigFormat:
    """One value of `calib rig export --format`."""

    name: str
    summary: str
    lenses: tuple[ExportLens, ...]
    files: Callable[[CentralRig, str], dict[str, str]]
    """A function that returns the texts by the files' names, for a depth as names have it."""


def opencv_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return stereo_Zm.yml as cv2.FileStorage reads it, with the names of OpenCV's stereo sample:
    M1, D1, M2, D2, R, T and, of cv2.stereoRectify, R1, R2, P1, P2, Q.
    """
    (_, first), (name, second) = rig.pair()
    pose = rig.poses[name]
    rectification = rectified(rig)
    file = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in rig.statements:
        file.writeComment(line)
    file.write("image_width", first.width)
    file.write("image_height", first.height)
    values = {
        "M1": first.matrix,
        "D1": np.array([first.distortion]),
        "M2": second.matrix,
        "D2": np.array([second.distortion]),
        "R": pose[:3, :3],
        "T": pose[:3, 3:],
        **dict(zip(("R1", "R2", "P1", "P2", "Q"), rectification, strict=True)),
    }
    for key, value in values.items():
        file.write(key, np.ascontiguousarray(value))
    return {f"stereo_{depth}m.yml": file.releaseAndGetString()}


def ros_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return a camera_info of each camera of a pair, with the rectification and the projection that
    stereo_image_proc takes: P of the second camera has -fx baseline.
    """
    cameras = rig.pair()
    first_turn, second_turn, first_projection, second_projection, _ = rectified(rig)
    turns = first_turn, second_turn
    projections = first_projection, second_projection
    texts = {}
    for (name, model), turn, projection in zip(cameras, turns, projections, strict=True):
        content = camera_content(model, name, turn, projection)
        texts[f"{name}_{depth}m.yaml"] = model.commented() + yaml.safe_dump(
            content, sort_keys=False, default_flow_style=None, width=120
        )
    return texts


def kalibr_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return Kalibr's camchain of all cameras, each with T_cn_cnm1 from the camera before it."""
    chain = {}
    previous = np.eye(4)
    for index, (name, model) in enumerate(rig.models.items()):
        overlaps = [other for other in range(len(rig.models)) if other != index]
        entry = camera_entry(model, f"/{name}/image_raw") | {"cam_overlaps": overlaps}
        if index:
            entry["T_cn_cnm1"] = (rig.poses[name] @ np.linalg.inv(previous)).tolist()
        previous = rig.poses[name]
        chain[f"cam{index}"] = entry
    text = yaml.safe_dump(chain, sort_keys=False, default_flow_style=None, width=120)
    return {f"camchain_{depth}m.yaml": rig.comments + text}


def mrcal_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return a .cameramodel of each camera. Their common reference frame is the frame of the rig's
    reference camera.
    """
    return {
        f"{name}_{depth}m.cameramodel": cameramodel(model, rig.from_reference[name])
        for name, model in rig.models.items()
    }


RIG_FORMATS = (
    RigFormat("opencv", "stereo.yml of cv2.stereoCalibrate's names", STEREO_LENSES, opencv_files),
    RigFormat("ros", "a camera_info of each camera of a pair", ROS, ros_files),
    RigFormat("kalibr", "a camchain of all cameras", KALIBR_LENSES, kalibr_files),
    RigFormat("colmap", "a sparse model with the rig and its frames", COLMAP, colmap_files),
    RigFormat("mrcal", "a .cameramodel of each camera", MRCAL, mrcal_files),
    RigFormat("depthai", "the calibration of a Luxonis board", DEPTHAI_LENSES, depthai_files),
    RigFormat("caliscope", "a camera array", CALISCOPE_LENSES, caliscope_files),
)
"""The formats, in the order of the help."""
