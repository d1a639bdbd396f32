"""Read the cameras of a rig, and where they are, from another program's calibration: Kalibr's
camchain, mrcal's .cameramodels of one solve, or the stereo files of OpenCV's sample.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.importing.from_kalibr import CAMERA
from calib.importing.from_mrcal import read_cameramodel
from calib.importing.opencv_file import opened_storage
from calib.io.yaml_reader import read_yaml
from calib.rig.imported_rig import ImportedCamera, intrinsics_mapping
from calib.session.lens import FISHEYE, OPENCV
from calib.session.schema import Section

Array = NDArray[np.float64]

MAX_ROTATION_ERROR = 1e-3
"""The largest deviation of R^T R from 1: files have six digits and more."""
MRCAL_LENSES = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
}
"""The number of coefficients of mrcal's lenses that a session has."""


def kalibr_cameras(file: Path) -> tuple[ImportedCamera, ...]:
    """Return the cameras of a camchain, called as there."""
    chain = Section(read_yaml(file), str(file))
    names = sorted(
        (key for key in chain.values if CAMERA.fullmatch(key)), key=lambda key: int(key[3:])
    )
    if not names:
        raise InputError(
            f"{file} has no cam0: give Kalibr's camchain.yaml, mrcal's .cameramodels, or OpenCV's"
            " stereo.yml."
        )
    cameras = []
    pose = np.eye(4)
    for index, name in enumerate(names):
        section = chain.section(name, "{camera_model: pinhole, resolution: [752, 480]}")
        if index:
            step = section.get("T_cn_cnm1", "the 4x4 transform from the camera before it")
            pose = _pose(file, f"{name}.T_cn_cnm1", step) @ pose
        resolution = section.get("resolution", "[width, height]")
        width, height = _numbers(file, f"{name}.resolution", resolution, 2)
        size = int(width), int(height)
        cameras.append(ImportedCamera(name, size, _kalibr_intrinsics(file, section), pose))
    return tuple(cameras)


def _kalibr_intrinsics(file: Path, section: Section) -> dict[str, object] | None:
    """Return the intrinsics; None for a model that a session does not have."""
    lens = str(section.values.get("distortion_model"))
    models = {"radtan": OPENCV, "equidistant": FISHEYE, "none": OPENCV}
    if section.values.get("camera_model") != "pinhole" or lens not in models:
        return None
    pinhole = _numbers(file, "intrinsics", section.values.get("intrinsics"), 4)
    coefficients = _numbers(file, "distortion_coeffs", section.values.get("distortion_coeffs", []))
    return intrinsics_mapping(pinhole, coefficients, models[lens])


def mrcal_cameras(files: Sequence[Path]) -> tuple[ImportedCamera, ...]:
    """Return the cameras of .cameramodels with one reference frame, called after their files."""
    cameras: list[ImportedCamera] = []
    from_first: Array = np.eye(4)
    for file in files:
        model = read_cameramodel(file)
        numbers = _numbers(file, "extrinsics", model.get("extrinsics"), 6)
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(np.array(numbers[:3]))[0]
        pose[:3, 3] = numbers[3:]
        if not cameras:
            from_first = np.asarray(np.linalg.inv(pose), np.float64)
        imager = _numbers(file, "imagersize", model["imagersize"], 2)
        intrinsics = None
        lens = str(model["lensmodel"])
        if lens in MRCAL_LENSES:
            count = 4 + MRCAL_LENSES[lens]
            values = _numbers(file, "intrinsics", model["intrinsics"], count)
            intrinsics = intrinsics_mapping(values[:4], values[4:])
        name = re.sub(r"\W+", "_", file.stem, flags=re.ASCII)
        name = name if name.isidentifier() else f"camera_{name}"
        size = int(imager[0]), int(imager[1])
        cameras.append(ImportedCamera(name, size, intrinsics, pose @ from_first))
    if len({camera.name for camera in cameras}) < len(cameras):
        raise InputError(
            f"{files[0]} is given twice, or two files have the same name: give the model of each"
            " camera once, under a name of its own."
        )
    return tuple(cameras)


def opencv_cameras(files: Sequence[Path]) -> tuple[ImportedCamera, ...]:
    """Return left and right of M1, D1, M2, D2, R and T, which may stand in two files."""
    matrices: dict[str, Array] = {}
    size: tuple[int, int] | None = None
    for file in files:
        with opened_storage(file) as storage:
            for key in ("M1", "D1", "M2", "D2", "R", "T"):
                if not storage.getNode(key).empty():
                    matrices[key] = np.asarray(storage.getNode(key).mat(), np.float64)
            width = storage.getNode("image_width")
            height = storage.getNode("image_height")
            if not width.empty() and not height.empty():
                size = int(width.real()), int(height.real())
    source = files[0]
    missing = [key for key in ("M1", "D1", "M2", "D2", "R", "T") if key not in matrices]
    if missing:
        raise InputError(
            f"{source} lacks {', '.join(missing)}: give OpenCV's stereo.yml, or its intrinsics.yml"
            " and extrinsics.yml together."
        )
    pose = np.eye(4)
    try:
        pose[:3, :3] = matrices["R"]
        pose[:3, 3] = matrices["T"].ravel()
    except ValueError as error:
        raise InputError(f"{source}: R must be a 3x3 matrix and T have three numbers.") from error
    pose = _pose(source, "R", pose.tolist())
    cameras = []
    for name, number, place in (("left", 1, np.eye(4)), ("right", 2, pose)):
        matrix = matrices[f"M{number}"]
        if matrix.shape != (3, 3):
            raise InputError(f"{source}: M{number} must be a 3x3 matrix.")
        pinhole = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
        lens = matrices[f"D{number}"].ravel().tolist()
        intrinsics = intrinsics_mapping([float(value) for value in pinhole], lens)
        cameras.append(ImportedCamera(name, size, intrinsics, place))
    return tuple(cameras)


def _numbers(file: Path, key: str, written: object, count: int | None = None) -> list[float]:
    """Return a list of numbers of a file, of this length if one is given."""
    try:
        values = [float(value) for value in written]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        values = []
    right = isinstance(written, list | tuple) and len(values) == len(written)
    if not right or not np.isfinite(values).all() or count not in (None, len(values)):
        length = "a list of" if count is None else f"{count}"
        raise InputError(
            f"{file}: {key} must be {length} numbers: write the file again with its program."
        )
    return values


def _pose(file: Path, key: str, written: object) -> Array:
    """Return the (4, 4) pose that a file has as rows."""
    rows = written if isinstance(written, list) else []
    values = [_numbers(file, key, row, 4) for row in rows]
    pose = np.array(values)
    if pose.shape != (4, 4) or (
        np.abs(pose[:3, :3].T @ pose[:3, :3] - np.eye(3)).max() > MAX_ROTATION_ERROR
        or np.linalg.det(pose[:3, :3]) < 0
    ):
        raise InputError(
            f"{file}: {key} has no rotation matrix: write the file again with its program."
        )
    return pose
