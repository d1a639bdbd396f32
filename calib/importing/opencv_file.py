"""Read the camera of a YAML, XML or JSON file of cv2.FileStorage, as OpenCV's calibration sample
writes it, or of plain YAML or JSON, as ROS's camera_info and Python's scripts have it.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.files import read_file
from calib.io.yaml_reader import MAX_FOREIGN_BYTES, is_opencv, read_yaml
from calib.session.lens import COEFFICIENTS

CAMERA_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "mtx", "K")
LENS_KEYS = (
    *("distortion_coefficients", "dist_coeffs", "dist_coeff", "distCoeffs"),
    *("Distortion_Coefficients", "dist", "D"),
)
ROS_FISHEYE = ("equidistant", "fisheye")
"""The lens models of ROS that are those of cv2.fisheye."""

FISHEYE_COUNT = 4
"""The number of coefficients of cv2.fisheye."""


@contextmanager
def opened_storage(file: Path) -> Iterator[cv2.FileStorage]:
    """Open a file of cv2.FileStorage; InputError if it is none."""
    text = read_file(file, MAX_FOREIGN_BYTES).decode(errors="replace")
    try:
        yield cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError, TypeError, ValueError) as error:
        raise InputError(f"{file} is damaged: give a file that cv2.FileStorage wrote.") from error


@dataclass(frozen=True, slots=True)
class StoredCamera:
    """A camera as a file has it, unchecked."""

    matrix: NDArray[np.float64]
    """(3, 3), or empty if there is none."""
    lens: list[float]
    """The coefficients of the lens, one after the other."""
    lens_key: str
    """The key of the lens; empty if there is none."""
    fisheye: bool


def _opencv_camera(file: Path) -> StoredCamera:
    with opened_storage(file) as storage:
        nodes = {key: storage.getNode(key) for key in (*CAMERA_KEYS, *LENS_KEYS)}
        stored = {key: node.mat() for key, node in nodes.items() if not node.empty()}
        return _stored_camera(stored, fisheye=storage.getNode("fisheye_model").real() == 1)


def _plain_camera(file: Path) -> StoredCamera:
    document = read_yaml(file)
    fisheye = document.get("distortion_model") in ROS_FISHEYE
    try:
        return _stored_camera(document, fisheye=fisheye)
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"{file} has a camera_matrix or a lens that is not of numbers.") from error


def _stored_camera(stored: Mapping[str, object], *, fisheye: bool) -> StoredCamera:
    matrix_key = next((key for key in CAMERA_KEYS if key in stored), "")
    lens_key = next((key for key in LENS_KEYS if key in stored), "")
    matrix = _numbers(stored[matrix_key]) if matrix_key else np.zeros(0)
    lens = _numbers(stored[lens_key]).ravel().tolist() if lens_key else []
    square = matrix.reshape(3, 3) if matrix.size == 9 else matrix
    return StoredCamera(square, lens, lens_key, fisheye)


def _numbers(value: object) -> NDArray[np.float64]:
    """Return an array that may stand under `data`, as ROS has it."""
    return np.asarray(value["data"] if isinstance(value, Mapping) else value, np.float64)


def read_opencv_intrinsics(file: Path) -> list[float]:
    """Return fx, fy, cx, cy in px and the coefficients of OpenCV's lens.

    Raises:
        InputError: the file is not OpenCV's, or has no such camera.
    """
    stored = _opencv_camera(file) if is_opencv(file) else _plain_camera(file)
    matrix, lens, key = stored.matrix, stored.lens, stored.lens_key
    if matrix.shape != (3, 3) or len(lens) not in COEFFICIENTS:
        counts = ", ".join(map(str, COEFFICIENTS))
        raise InputError(
            f"{file} lacks a camera_matrix of 3x3 numbers, or distortion_coefficients of {counts}"
            " numbers: write fx,fy,cx,cy and the coefficients, such as 1200,1200,640,360"
        )
    if key == "D" and len(lens) == FISHEYE_COUNT:
        raise InputError(
            f"{file} has 4 numbers in D, as cv2.fisheye writes them: write camera.intrinsics with"
            " model: fisheye in session.yaml. If they are k1, k2, p1 and p2, write"
            " fx,fy,cx,cy,k1,k2,p1,p2 in place of the file."
        )
    if stored.fisheye:
        raise InputError(
            f"{file} is of a fisheye lens: write camera.intrinsics with model: fisheye in"
            " session.yaml."
        )
    pinhole = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    return [*map(float, pinhole), *lens]
