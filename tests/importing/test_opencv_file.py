"""The lens of a file that OpenCV's calibration sample writes."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cli import main
from calib.commands.cover_options import typed_intrinsics
from calib.errors import InputError
from calib.importing.opencv_file import read_opencv_intrinsics

LENS = [0.1, -0.2, 0.001, 0.002, 0.03]


def write_camera(file: Path, coefficients: list[float], fisheye: int = 0) -> Path:
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    storage.write("fisheye_model", fisheye)
    storage.write("camera_matrix", np.array([[640.5, 0, 416.25], [0, 641, 317.75], [0, 0, 1.0]]))
    storage.write("distortion_coefficients", np.array([coefficients]))
    storage.release()
    return file


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_a_lens_is_read(suffix: str, tmp_path: Path) -> None:
    file = write_camera(tmp_path / f"camera.{suffix}", LENS)
    assert typed_intrinsics(str(file)) == [640.5, 641.0, 416.25, 317.75, *LENS]


NUMBERS = [640.5, 0, 416.25, 0, 641, 317.75, 0, 0, 1]
ROWS = [NUMBERS[:3], NUMBERS[3:6], NUMBERS[6:]]


@pytest.mark.parametrize(
    ("matrix", "lens"),
    [
        (ROWS, [LENS]),
        ({"rows": 3, "cols": 3, "data": NUMBERS}, {"rows": 1, "cols": 5, "data": LENS}),
    ],
    ids=["lists", "camera_info"],
)
@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_a_lens_of_plain_text_is_read(
    matrix: object, lens: object, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"camera.{suffix}"
    document = {"camera_matrix": matrix, "distortion_coefficients": lens}
    file.write_text(json.dumps(document))
    assert typed_intrinsics(str(file)) == [640.5, 641.0, 416.25, 317.75, *LENS]
    file.write_text(json.dumps({**document, "distortion_model": "equidistant"}))
    with pytest.raises(InputError, match="is of a fisheye lens"):
        read_opencv_intrinsics(file)
    file.write_text(json.dumps({**document, "camera_matrix": "K"}))
    with pytest.raises(InputError, match="is not of numbers"):
        read_opencv_intrinsics(file)


def test_what_is_no_such_lens_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is of a fisheye lens"):
        read_opencv_intrinsics(write_camera(tmp_path / "a.yml", LENS[:4], fisheye=1))
    with pytest.raises(InputError, match="distortion_coefficients of 0, 4, 5"):
        read_opencv_intrinsics(write_camera(tmp_path / "b.yml", LENS[:3]))
    storage = cv2.FileStorage(str(tmp_path / "d.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("K", np.eye(3))
    storage.write("D", np.array([LENS[:4]]))
    storage.release()
    with pytest.raises(InputError, match=r"as cv2\.fisheye writes them"):
        read_opencv_intrinsics(tmp_path / "d.yml")
    (tmp_path / "c.yml").write_text("a: 1\n")
    with pytest.raises(InputError, match="lacks a camera_matrix"):
        read_opencv_intrinsics(tmp_path / "c.yml")


def test_the_file_is_no_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_camera(tmp_path / "a.yml", LENS)
    assert main(["undistort", str(file), "x.png", "--depth", "1", "-o", str(tmp_path / "o")]) == 2
    assert f"`calib fit PICTURES --intrinsics {file}` takes its numbers" in capsys.readouterr().err
