"""A rig as COLMAP's sparse model in text, with rigs and frames as COLMAP has them from 3.12 on.

The rig's frame is that of the first camera. Each placement of the board is a frame, and the world
is the board, so rig_from_world is where the board stood. The model has no points.
rig_config_Zm.json holds the same cameras for `colmap rig_configurator`, which puts them into a
database with pictures of another scene.

Source: doc/format.rst and doc/rigs.rst of COLMAP.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.errors import InputError
from calib.export.colmap import camera_line, camera_parameters
from calib.rig.central_rig import CentralRig

Array = NDArray[np.float64]


def colmap_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return the files of the model, whose names COLMAP prescribes, and rig_config_Zm.json."""
    rigs, cameras = _rig_lines(rig), _camera_lines(rig)
    frames, images = _frame_lines(rig)
    points = ["# 3D points, one a line: none"]
    texts = {
        "rigs.txt": rigs,
        "cameras.txt": cameras,
        "frames.txt": frames,
        "images.txt": images,
        "points3D.txt": points,
    }
    files = {name: rig.comments + "".join(f"{line}\n" for line in texts[name]) for name in texts}
    return files | {f"rig_config_{depth}m.json": _configuration(rig)}


def _rig_lines(rig: CentralRig) -> list[str]:
    others = tuple(rig.models)[1:]
    sensors = [
        f"CAMERA {number} 1 {_pose_text(rig.poses[name])}"
        for number, name in enumerate(others, start=2)
    ]
    return [
        "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE,"
        " SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])",
        "# Number of rigs: 1",
        " ".join([f"1 {len(rig.models)} CAMERA 1", *sensors]),
    ]


def _camera_lines(rig: CentralRig) -> list[str]:
    lines = [
        camera_line(model, number) for number, model in enumerate(rig.models.values(), start=1)
    ]
    return [
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
        f"# Number of cameras: {len(lines)}",
        *lines,
    ]


def _frame_lines(rig: CentralRig) -> tuple[list[str], list[str]]:
    """Return the lines of frames.txt and of images.txt."""
    frames = [
        "# FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, DATA_IDS[]"
        " as (SENSOR_TYPE, SENSOR_ID, DATA_ID)",
        f"# Number of frames: {len(rig.frames)}",
    ]
    images = [
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "# POINTS2D[] as (X, Y, POINT3D_ID)",
        f"# Number of images: {sum(len(frame.pictures) for frame in rig.frames)}",
    ]
    first, *_ = rig.models
    image = 0
    for number, frame in enumerate(rig.frames, start=1):
        rig_from_world = rig.from_reference[first] @ frame.T_reference_board
        data = []
        for camera, name in enumerate(rig.models, start=1):
            if name not in frame.pictures:
                continue
            image += 1
            picture = _picture_name(name, frame.pictures[name])
            pose = rig.from_reference[name] @ frame.T_reference_board
            images += [f"{image} {_pose_text(pose)} {camera} {picture}", ""]
            data.append(f"CAMERA {camera} {image}")
        frames.append(" ".join([f"{number} 1 {_pose_text(rig_from_world)} {len(data)}", *data]))
    return frames, images


def _picture_name(camera: str, file: str) -> str:
    name = f"{camera}/{file}"
    if len(name.split()) > 1:
        raise InputError(
            f"The picture {name} has a space in its name, which COLMAP's text does not allow:"
            " rename the pictures and fit the rig again."
        )
    return name


def _configuration(rig: CentralRig) -> str:
    """Return the text of rig_config_Zm.json."""
    cameras = []
    for index, (name, model) in enumerate(rig.models.items()):
        camera: dict[str, object] = {"image_prefix": f"{name}/"}
        if index:
            camera["cam_from_rig_rotation"] = _quaternion(rig.poses[name])
            camera["cam_from_rig_translation"] = rig.poses[name][:3, 3].tolist()
        else:
            camera["ref_sensor"] = True
        camera["camera_model_name"] = model.lens.name
        camera["camera_params"] = camera_parameters(model)
        cameras.append(camera)
    return json.dumps([{"cameras": cameras}], indent=2) + "\n"


def _pose_text(pose: Array) -> str:
    """Return QW, QX, QY, QZ, TX, TY, TZ (m) of a (4, 4) pose."""
    return " ".join(map(repr, [*_quaternion(pose), *pose[:3, 3].tolist()]))


def _quaternion(pose: Array) -> list[float]:
    """Return w, x, y, z of a (4, 4) pose's rotation, with w >= 0."""
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True).tolist()
    return [w, x, y, z]
