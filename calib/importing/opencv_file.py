"""Read the camera of a YAML, XML or JSON file of cv2.FileStorage, as OpenCV's calibration sample
writes it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.files import read_file
from calib.io.yaml_reader import MAX_FOREIGN_BYTES
from calib.session.lens import COEFFICIENTS

CAMERA_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
LENS_KEYS = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "D")

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


def read_opencv_intrinsics(file: Path) -> list[float]:
    """Return fx, fy, cx, cy in px and the coefficients of OpenCV's lens.

    Raises:
        InputError: the file is not OpenCV's, or has no such camera.
    """
    matrix: NDArray[np.float64] | None = None
    lens: list[float] = []
    fisheye = False
    key = ""
    with opened_storage(file) as storage:
        for key in CAMERA_KEYS:
            node = storage.getNode(key)
            if not node.empty():
                matrix = np.asarray(node.mat(), np.float64)
                break
        for key in LENS_KEYS:
            node = storage.getNode(key)
            if not node.empty():
                lens = np.asarray(node.mat(), np.float64).ravel().tolist()
                break
        fisheye = storage.getNode("fisheye_model").real() == 1
    if matrix is None or matrix.shape != (3, 3) or len(lens) not in COEFFICIENTS:
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
    if fisheye:
        raise InputError(
            f"{file} is of a fisheye lens: write camera.intrinsics with model: fisheye in"
            " session.yaml."
        )
    pinhole = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    return [*map(float, pinhole), *lens]
