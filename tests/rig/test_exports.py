"""A rig's files for other programs: a point that each file's numbers project is where the rig sees
it, by the program itself where it is installed, else by its published formula.
"""

import ast
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.cli import main
from calib.errors import InputError
from calib.export.central import best_central
from calib.export.formats import COLMAP, MRCAL, ExportLens
from calib.rig.caliscope_array import CALISCOPE_LENSES, caliscope_files
from calib.rig.central_rig import CentralRig
from calib.rig.colmap_model import colmap_files
from calib.rig.depthai_board import DEPTHAI_LENSES, depthai_files
from calib.rig.exports import kalibr_files, mrcal_files, opencv_files, ros_files
from calib.rig.rig import Rig
from tests.rig.conftest import DEPTH

Array = NDArray[np.float64]
POINTS = np.array([[0.05, 0.02, DEPTH], [-0.04, 0.06, DEPTH], [0.02, -0.05, DEPTH]])
"""m, in the frame of the rig's reference."""
NEAR = 0.1
"""px: the misfit of the small pictures' central cameras is 0.01 to 0.04 px."""


def test_exports_say_where_the_cameras_are(small: Rig) -> None:
    """A point that OpenCV projects by the file's numbers is where the rig sees it at the depth."""
    lenses = (ExportLens("opencv", 5), ExportLens("opencv", 8))
    central = CentralRig.of(small, small.names, DEPTH, lenses)
    (text,) = opencv_files(central, "0.7").values()
    file = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    matrices = {key: file.getNode(key).mat() for key in ("M1", "D1", "M2", "D2", "R", "T", "P2")}
    model = best_central(small.calibrations["left"], DEPTH, lenses)
    place = np.array([[0.05, 0.02, DEPTH], [-0.04, 0.06, DEPTH]])
    from_first = place - np.array(model.centre)
    first = cv2.projectPoints(from_first, np.zeros(3), np.zeros(3), matrices["M1"], matrices["D1"])
    turn = cv2.Rodrigues(matrices["R"])[0]
    second = cv2.projectPoints(from_first, turn, matrices["T"], matrices["M2"], matrices["D2"])
    visible = small.project(place)
    assert np.abs(first[0].reshape(-1, 2) - visible["left"]).max() < NEAR
    assert np.abs(second[0].reshape(-1, 2) - visible["right"]).max() < NEAR
    assert "Misfit over the image" in text
    texts = ros_files(central, "0.7")
    assert list(texts) == ["left_0.7m.yaml", "right_0.7m.yaml"]
    info = yaml.safe_load(texts["right_0.7m.yaml"])
    projection = np.array(info["projection_matrix"]["data"]).reshape(3, 4)
    assert projection == pytest.approx(matrices["P2"])
    assert projection[0, 3] / projection[0, 0] == pytest.approx(
        -np.linalg.norm(matrices["T"]), rel=1e-9
    )
    radtan = (ExportLens("radtan", 4),)
    chain = yaml.safe_load(
        kalibr_files(CentralRig.of(small, small.names, DEPTH, radtan), "0.7")["camchain_0.7m.yaml"]
    )
    assert chain["cam1"]["cam_overlaps"] == [0]
    shift = np.array(chain["cam1"]["T_cn_cnm1"])[:3, 3]
    assert np.linalg.norm(shift) == pytest.approx(small.baselines[0].metres, rel=0.02)


def from_first(rig: CentralRig) -> Array:
    """POINTS in the frame of the first central camera."""
    pose = rig.from_reference[next(iter(rig.models))]
    return np.asarray(POINTS @ pose[:3, :3].T + pose[:3, 3])


def check(rig: Rig, name: str, points: Array, pose: Array, matrix: Array, lens: Array) -> None:
    """Points that a (4, 4) pose and a lens of OpenCV's project are where the camera sees POINTS."""
    turn = cv2.Rodrigues(np.ascontiguousarray(pose[:3, :3]))[0]
    pixels, _ = cv2.projectPoints(points, turn, pose[:3, 3], matrix, lens)
    assert np.abs(pixels.reshape(-1, 2) - rig.project(POINTS)[name]).max() < NEAR


def rigid(quaternion: list[float], translation: list[float]) -> Array:
    """The (4, 4) pose of w, x, y, z and a translation."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    pose[:3, 3] = translation
    return pose


def rows(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines() if line and not line.startswith("#")]


def test_colmap_s_rig(small: Rig) -> None:
    central = CentralRig.of(small, small.names, DEPTH, COLMAP[1:2])
    files = colmap_files(central, "0.7")
    ((identity, count, kind, reference, *sensor),) = rows(files["rigs.txt"])
    assert [identity, count, kind, reference, *sensor[:3]] == [
        "1",
        "2",
        "CAMERA",
        "1",
        "CAMERA",
        "2",
        "1",
    ]
    pose = rigid([float(n) for n in sensor[3:7]], [float(n) for n in sensor[7:]])
    for name, row, place in zip(
        small.names, rows(files["cameras.txt"]), (np.eye(4), pose), strict=True
    ):
        assert row[1:4] == ["FULL_OPENCV", "410", "308"]
        fx, fy, cx, cy, *lens = map(float, row[4:])
        matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
        check(small, name, from_first(central), place, matrix, np.array(lens))
    assert all("Misfit over the image" in text for name, text in files.items() if "txt" in name)


def test_colmap_s_frames(fitted: Rig) -> None:
    """Each image's pose is that of its frame and its camera, and of the board."""
    central = CentralRig.of(fitted, fitted.names, DEPTH, COLMAP[:1])
    files = colmap_files(central, "0.7")
    (configuration,) = json.loads(files["rig_config_0.7m.json"])
    second = configuration["cameras"][1]
    sensor = rigid(second["cam_from_rig_rotation"], second["cam_from_rig_translation"])
    images = {row[0]: row for row in rows(files["images.txt"])}
    frames = rows(files["frames.txt"])
    assert len(frames) == len(fitted.placements)
    assert len(images) == sum(len(c.views) for c in fitted.calibrations.values())
    for frame in frames:
        world = rigid([float(n) for n in frame[2:6]], [float(n) for n in frame[6:9]])
        assert int(frame[9]) == len(frame[10:]) / 3
        for camera, image in zip(frame[11::3], frame[12::3], strict=True):
            row = images[image]
            pose = rigid([float(n) for n in row[1:5]], [float(n) for n in row[5:8]])
            assert row[8] == camera
            expected = sensor @ world if camera == "2" else world
            assert pose == pytest.approx(expected, abs=1e-9)
            assert row[9].startswith("left/" if camera == "1" else "right/")


def test_a_picture_with_a_space_is_refused_for_colmap(fitted: Rig) -> None:
    central = CentralRig.of(fitted, fitted.names, DEPTH, COLMAP[:1])
    frame = replace(central.frames[0], pictures={"left": "my picture.png"})
    with pytest.raises(InputError, match=r"left/my picture\.png has a space"):
        colmap_files(replace(central, frames=(frame,)), "0.7")


def test_mrcal_s_models(small: Rig) -> None:
    """Both models have the reference frame of the rig."""
    files = mrcal_files(CentralRig.of(small, small.names, DEPTH, MRCAL[2:3]), "0.7")
    for name in small.names:
        text = files[f"{name}_0.7m.cameramodel"]
        assert "# Misfit over the image" in text
        model = ast.literal_eval(text)
        assert model["lensmodel"] == "LENSMODEL_OPENCV8"
        fx, fy, cx, cy, *lens = model["intrinsics"]
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(np.array(model["extrinsics"][:3]))[0]
        pose[:3, 3] = model["extrinsics"][3:]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        check(small, name, POINTS, pose, matrix, np.array(lens))


def test_depthai_s_board(small: Rig) -> None:
    central = CentralRig.of(small, small.names, DEPTH, DEPTHAI_LENSES[1:2])
    content = json.loads(depthai_files(central, "0.7")["calibration_0.7m.json"])
    cameras = dict(content["cameraData"])
    assert list(cameras) == [1, 2]
    link = cameras[1]["extrinsics"]
    assert (link["toCameraSocket"], cameras[2]["extrinsics"]["toCameraSocket"]) == (2, -1)
    pose = np.eye(4)
    pose[:3, :3] = link["rotationMatrix"]
    pose[:3, 3] = [link["translation"][axis] / 100 for axis in "xyz"]  # from cm
    for name, camera, place in zip(small.names, cameras.values(), (np.eye(4), pose), strict=True):
        assert len(camera["distortionCoeff"]) == 14
        matrix = np.array(camera["intrinsicMatrix"])
        check(small, name, from_first(central), place, matrix, np.array(camera["distortionCoeff"]))
    turns = content["stereoRectificationData"]
    baseline = np.array(turns["rectifiedRotationRight"]) @ pose[:3, 3]
    assert baseline[1:] == pytest.approx(0, abs=1e-9)  # along x: rows are aligned
    assert any("Misfit over the image" in line for line in content["refracal"])


def test_caliscope_s_array(small: Rig) -> None:
    central = CentralRig.of(small, small.names, DEPTH, CALISCOPE_LENSES[:1])
    text = caliscope_files(central, "0.7")["camera_array_0.7m.toml"]
    assert "Misfit over the image" in text
    cameras = tomllib.loads(text)["cameras"]
    for name, camera in zip(small.names, cameras.values(), strict=True):
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(np.array(camera["rotation"]))[0]
        pose[:3, 3] = camera["translation"]
        matrix = np.array(camera["matrix"])
        check(small, name, from_first(central), pose, matrix, np.array(camera["distortions"]))
        assert camera["fisheye"] is False


def written(rig: Rig, folder: Path, form: str) -> Path:
    rig.save(folder / "rig")
    words = ["rig", "export", str(folder / "rig"), "--format", form, "--depth", "0.7"]
    assert main([*words, "-o", str(folder / form)]) == 0
    return folder / form


@pytest.mark.slow
def test_colmap_reads_its_model(fitted: Rig, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", minversion="3.12")
    folder = written(fitted, tmp_path, "colmap")
    model = pycolmap.Reconstruction(str(folder))
    assert (model.num_rigs(), model.num_frames()) == (1, len(fitted.placements))
    assert model.num_images() == sum(len(c.views) for c in fitted.calibrations.values())
    central = CentralRig.of(fitted, fitted.names, DEPTH, COLMAP)
    points = from_first(central)
    for number, name in enumerate(fitted.names, start=1):
        pose = np.eye(4)[:3]
        if number > 1:
            pose = model.rig(1).sensor_from_rig(model.camera(number).sensor_id).matrix()
        pixels = model.camera(number).img_from_cam(points @ pose[:, :3].T + pose[:, 3])
        assert np.abs(np.asarray(pixels) - 0.5 - fitted.project(POINTS)[name]).max() < 1


def test_depthai_reads_its_calibration(fitted: Rig, tmp_path: Path) -> None:
    dai = pytest.importorskip("depthai")
    folder = written(fitted, tmp_path, "depthai")
    handler = dai.CalibrationHandler(str(folder / "calibration_0.7m.json"))
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    central = CentralRig.of(fitted, fitted.names, DEPTH, DEPTHAI_LENSES)
    pose = np.array(handler.getCameraExtrinsics(left, right, False))
    pose[:3, 3] /= 100  # from cm; the device keeps single precision
    assert pose == pytest.approx(central.poses["right"], abs=1e-6)
    assert handler.getBaselineDistance(right, left, False) / 100 == pytest.approx(
        np.linalg.norm(pose[:3, 3]), rel=1e-5
    )


def test_caliscope_reads_its_array(fitted: Rig, tmp_path: Path) -> None:
    module = pytest.importorskip("caliscope.cameras.camera_array")
    folder = written(fitted, tmp_path, "caliscope")
    cameras = module.CameraArray.from_toml(folder / "camera_array_0.7m.toml").cameras
    central = CentralRig.of(fitted, fitted.names, DEPTH, CALISCOPE_LENSES)
    for camera, pose in zip(cameras.values(), central.poses.values(), strict=True):
        assert camera.transformation == pytest.approx(pose, abs=1e-12)
