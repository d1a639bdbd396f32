"""Each central format, read back by the program it is for, or by that program's published formula, reprojects to the stated misfit."""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.cli import main
from fixtures.synthetic import HEIGHT, WIDTH
from tests.export.truth import centre, check_misfit, distorted, fisheye, seen, statements

DEPTH = 0.4


@pytest.fixture(scope="module")
def saved(covered: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibration")
    covered.save(folder)
    return folder


def export(saved: Path, folder: Path, form: str, lens: str, name: str) -> Path:
    """The one file of that name that the command writes."""
    assert main(["export", str(saved), "--format", form, "--lens", lens, "--depth", str(DEPTH), "-o", str(folder)]) == 0
    return folder / name


@pytest.mark.parametrize("form", ["opencv", "opencv-xml"])
@pytest.mark.parametrize("lens", ["5", "12", "fisheye"])
def test_opencv(covered: Calibration, saved: Path, tmp_path: Path, form: str, lens: str) -> None:
    suffix = "xml" if form == "opencv-xml" else "yaml"
    path = export(saved, tmp_path, form, lens, f"camera_0.4m.{suffix}")
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix, coefficients, rvec, tvec = (file.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients", "rvec", "tvec"))
    assert (file.getNode("image_width").real(), file.getNode("image_height").real()) == (WIDTH, HEIGHT)
    assert file.getNode("distortion_model").string() == ("fisheye" if lens == "fisheye" else "opencv")
    for key, factor in (("misfit_at_depth", 1), ("misfit_at_half_depth", 0.5), ("misfit_at_double_depth", 2)):
        said = file.getNode(key)
        depth, rms, worst = (said.getNode(name).real() for name in ("depth_m", "rms_px", "worst_px"))
        assert depth == DEPTH * factor
        pixels, points = seen(covered, depth)
        if lens == "fisheye":
            projected, _ = cv2.fisheye.projectPoints(points[:, None], rvec, tvec, matrix, coefficients)
        else:
            projected, _ = cv2.projectPoints(points, rvec, tvec, matrix, coefficients)
        check_misfit(projected.reshape(-1, 2) - pixels, rms, worst)
    file.release()


def test_opencv_maps_are_the_calibration_s(small: Calibration, tmp_path: Path) -> None:
    """A picture whose pixels hold their own coordinates, through cv2.remap with the files, against projecting points."""
    small.save(tmp_path)
    export(tmp_path, tmp_path, "opencv", "5", "")
    map_x, map_y = (cv2.imread(str(tmp_path / f"map_{axis}_0.4m.tiff"), cv2.IMREAD_UNCHANGED) for axis in "xy")
    assert map_x is not None
    assert map_y is not None
    assert map_x.dtype == map_y.dtype == np.float32
    width, height = small.camera.width, small.camera.height
    assert map_x.shape == map_y.shape == (height, width)
    picture = np.dstack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)))
    straight = cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR)
    k = small.camera.intrinsics
    assert k
    at = np.random.default_rng(2).integers([50, 50], [width - 50, height - 50], (500, 2))
    tangents = (at - [k.cx.value, k.cy.value]) / [k.fx.value, k.fy.value]
    pixels = small.project(np.column_stack([tangents, np.ones(500)]) * DEPTH)
    assert np.abs(straight[at[:, 1], at[:, 0]] - pixels).max() < 0.01 + 1 / 64  # cv2.remap rounds to 1/32 px


@pytest.mark.parametrize("lens", ["plumb_bob", "rational_polynomial", "equidistant"])
def test_ros(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """As image_geometry does: D through the camera matrix K; P repeats K, so the rectified picture has the same scale."""
    text = export(saved, tmp_path, "ros", lens, "camera_info_0.4m.yaml").read_text()
    said = yaml.safe_load(text)
    assert said["distortion_model"] == lens
    assert said["camera_name"] == "Test_camera_3280x2464"
    assert (said["image_width"], said["image_height"]) == (WIDTH, HEIGHT)
    shapes = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
    k, r, p = (np.array(said[key]["data"]).reshape(said[key]["rows"], said[key]["cols"]) for key in shapes)
    assert [k.shape, r.shape, p.shape] == list(shapes.values())
    assert np.array_equal(p, np.column_stack([k, np.zeros(3)]))
    assert np.array_equal(r, np.eye(3))
    model = fisheye if lens == "equidistant" else distorted
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = model(points[:, :2] / points[:, 2:], said["distortion_coefficients"]["data"])
        check_misfit(bent @ k[:2, :2].T + k[:2, 2] - pixels, rms, worst)


@pytest.mark.parametrize("lens", ["radtan", "equidistant"])
def test_kalibr(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    text = export(saved, tmp_path, "kalibr", lens, "camchain_0.4m.yaml").read_text()
    camera = yaml.safe_load(text)["cam0"]
    assert (camera["camera_model"], camera["distortion_model"], camera["resolution"]) == ("pinhole", lens, [WIDTH, HEIGHT])
    fu, fv, pu, pv = camera["intrinsics"]
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = (fisheye if lens == "equidistant" else distorted)(points[:, :2] / points[:, 2:], camera["distortion_coeffs"])
        check_misfit(bent * [fu, fv] + [pu, pv] - pixels, rms, worst)


@pytest.mark.parametrize("lens", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_colmap(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """COLMAP counts pixels from the corner of the picture."""
    path = export(saved, tmp_path, "colmap", lens, "cameras_0.4m.txt")
    text = path.read_text()
    (line,) = [line for line in text.splitlines() if not line.startswith("#")]
    number, name, width, height, *params = line.split()
    assert (number, name, int(width), int(height)) == ("1", lens, WIDTH, HEIGHT)
    fx, fy, cx, cy, *coefficients = map(float, params)
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = (fisheye if lens == "OPENCV_FISHEYE" else distorted)(points[:, :2] / points[:, 2:], coefficients)
        check_misfit(bent * [fx, fy] + [cx, cy] - (pixels + 0.5), rms, worst)


@pytest.mark.parametrize("lens", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_colmap_by_pycolmap(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed: COLMAP's own reader was not tried")
    path = export(saved, tmp_path, "colmap", lens, "cameras_0.4m.txt")
    path.rename(tmp_path / "cameras.txt")
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).touch()
    (camera,) = pycolmap.Reconstruction(str(tmp_path)).cameras.values()
    text = (tmp_path / "cameras.txt").read_text()
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        projected = camera.img_from_cam(points - centre(text))
        check_misfit(projected - (pixels + 0.5), rms, worst)


MRCAL = """
import json, sys, mrcal, numpy as np
model = mrcal.cameramodel(sys.argv[1])
points = np.array(json.load(sys.stdin))
seen = mrcal.project(mrcal.transform_point_rt(model.extrinsics_rt_fromref(), points), *model.intrinsics())
print(json.dumps({"pixels": seen.tolist(), "size": [int(n) for n in model.imagersize()], "model": model.intrinsics()[0]}))
"""
PYTHON = "/usr/bin/python3"


def has_mrcal() -> bool:
    return Path(PYTHON).exists() and subprocess.run([PYTHON, "-c", "import mrcal"], capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not has_mrcal(), reason="mrcal is not installed (apt-get install python3-mrcal): its reader was not tried")
@pytest.mark.parametrize("lens", ["OPENCV4", "OPENCV8", "OPENCV12", "SPLINED"])
def test_mrcal(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """Points of the calibration's own camera frame: the extrinsics carry the shift."""
    path = export(saved, tmp_path, "mrcal", lens, "camera_0.4m.cameramodel")
    for depth, rms, worst in statements(path.read_text()):
        pixels, points = seen(covered, depth, 1000)
        command = [PYTHON, "-c", MRCAL, str(path)]
        done = subprocess.run(command, input=json.dumps(points.tolist()), capture_output=True, text=True, check=True)
        said = json.loads(done.stdout)
        assert said["model"].startswith(f"LENSMODEL_{lens}")
        assert said["size"] == [WIDTH, HEIGHT]
        check_misfit(np.array(said["pixels"]) - pixels, rms, worst)
