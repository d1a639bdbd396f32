"""Each central format, read back by the program it is for, or by that program's published formula,
reprojects to the stated misfit.
"""

import importlib
import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from calib.calibration import Calibration
from calib.cli import main
from fixtures.synthetic import HEIGHT, WIDTH
from tests.export.truth import centre, check_misfit, distorted, fisheye, seen, statements

DEPTH = 0.4
NAMES = {
    "ros": "camera_info_0.4m.yaml",
    "kalibr": "camchain_0.4m.yaml",
    "colmap": "cameras_0.4m.txt",
}

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def saved(covered: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibration")
    covered.save(folder)
    return folder


def export(saved: Path, folder: Path, form: str, lens: str, name: str) -> Path:
    """The one file of that name that the command writes."""
    assert (
        main(
            [
                "export",
                str(saved),
                "--format",
                form,
                "--lens",
                lens,
                "--depth",
                str(DEPTH),
                "-o",
                str(folder),
            ]
        )
        == 0
    )
    return folder / name


@pytest.mark.parametrize("form", ["opencv", "opencv-xml"])
@pytest.mark.parametrize("lens", ["5", "12", "fisheye"])
def test_opencv(covered: Calibration, saved: Path, tmp_path: Path, form: str, lens: str) -> None:
    suffix = "xml" if form == "opencv-xml" else "yaml"
    path = export(saved, tmp_path, form, lens, f"camera_0.4m.{suffix}")
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix = file.getNode("camera_matrix").mat()
    coefficients = file.getNode("distortion_coefficients").mat()
    rvec = file.getNode("rvec").mat()
    tvec = file.getNode("tvec").mat()
    assert (file.getNode("image_width").real(), file.getNode("image_height").real()) == (
        WIDTH,
        HEIGHT,
    )
    assert file.getNode("distortion_model").string() == (
        "fisheye" if lens == "fisheye" else "opencv"
    )
    for key, factor in (
        ("misfit_at_depth", 1),
        ("misfit_at_half_depth", 0.5),
        ("misfit_at_double_depth", 2),
    ):
        node = file.getNode(key)
        depth = node.getNode("depth_m").real()
        rms = node.getNode("rms_px").real()
        worst = node.getNode("worst_px").real()
        assert depth == DEPTH * factor
        pixels, points = seen(covered, depth)
        if lens == "fisheye":
            projected, _ = cv2.fisheye.projectPoints(
                points[:, None], rvec, tvec, matrix, coefficients
            )
        else:
            projected, _ = cv2.projectPoints(points, rvec, tvec, matrix, coefficients)
        check_misfit(projected.reshape(-1, 2) - pixels, rms, worst)
    file.release()


def test_opencv_maps_are_the_calibration_s(small: Calibration, tmp_path: Path) -> None:
    """A picture whose pixels hold their own coordinates, through cv2.remap with the files, against
    projecting points.
    """
    small.save(tmp_path)
    export(tmp_path, tmp_path, "opencv", "5", "")
    map_x = cv2.imread(str(tmp_path / "map_x_0.4m.tiff"), cv2.IMREAD_UNCHANGED)
    map_y = cv2.imread(str(tmp_path / "map_y_0.4m.tiff"), cv2.IMREAD_UNCHANGED)
    assert map_x is not None
    assert map_y is not None
    assert map_x.dtype == map_y.dtype == np.float32
    width, height = small.camera.width, small.camera.height
    assert map_x.shape == map_y.shape == (height, width)
    picture = np.dstack(
        np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    )
    straight = cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR)
    k = small.camera.intrinsics
    assert k
    at = np.random.default_rng(2).integers([50, 50], [width - 50, height - 50], (500, 2))
    tangents = (at - [k.cx.value, k.cy.value]) / [k.fx.value, k.fy.value]
    pixels = small.project(np.column_stack([tangents, np.ones(500)]) * DEPTH)
    assert (
        np.abs(straight[at[:, 1], at[:, 0]] - pixels).max() < 0.01 + 1 / 64
    )  # cv2.remap rounds to 1/32 px


@pytest.mark.parametrize("lens", ["plumb_bob", "rational_polynomial", "equidistant"])
def test_ros(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """The reader works as image_geometry does: D through the camera matrix K; P repeats K, so the
    rectified picture has the same scale.
    """
    text = export(saved, tmp_path, "ros", lens, "camera_info_0.4m.yaml").read_text()
    document = yaml.safe_load(text)
    assert document["distortion_model"] == lens
    assert document["camera_name"] == "Test_camera_3280x2464"
    assert (document["image_width"], document["image_height"]) == (WIDTH, HEIGHT)
    shapes = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
    matrices = [
        np.array(document[key]["data"]).reshape(document[key]["rows"], document[key]["cols"])
        for key in shapes
    ]
    k, r, p = matrices
    assert [k.shape, r.shape, p.shape] == list(shapes.values())
    assert np.array_equal(p, np.column_stack([k, np.zeros(3)]))
    assert np.array_equal(r, np.eye(3))
    model = fisheye if lens == "equidistant" else distorted
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = model(points[:, :2] / points[:, 2:], document["distortion_coefficients"]["data"])
        check_misfit(bent @ k[:2, :2].T + k[:2, 2] - pixels, rms, worst)


@pytest.mark.parametrize("form", ["ros", "kalibr", "colmap"])
def test_the_shift_of_the_centre_as_each_program_takes_it(
    covered: Calibration, saved: Path, tmp_path: Path, form: str
) -> None:
    """A point of the calibration's frame, moved as the file says, is where the file's camera has
    it.
    """
    lens = {"ros": "plumb_bob", "kalibr": "radtan", "colmap": "OPENCV"}[form]
    text = export(saved, tmp_path, form, lens, NAMES[form]).read_text()
    _, points = seen(covered, 0.2)
    if form == "ros":  # tf2: the child's origin in its parent's frame
        lines = [line for line in text.splitlines() if "static_transform_publisher" in line]
        (line,) = lines
        words = line.split()
        moved = points - [float(words[words.index(f"--{axis}") + 1]) for axis in "xyz"]
        assert words[words.index("--child-frame-id") + 1] == "Test_camera_3280x2464_optical_frame"
    elif form == "kalibr":
        lines = [line for line in text.splitlines() if line.startswith("# [[")]
        (line,) = lines
        transform = np.array(json.loads(line.removeprefix("# ")))
        moved = (transform @ np.column_stack([points, np.ones(len(points))]).T).T[:, :3]
    else:
        lines = [line for line in text.splitlines() if "TX TY TZ" in line]
        (line,) = lines
        moved = points + [float(word) for word in line.split()[-3:]]
    assert (
        np.abs(moved - (points - centre(text))).max() < 1e-9
    )  # the other comment rounds to 1e-6 mm
    assert np.linalg.norm(centre(text)) > 1e-4


def test_a_central_camera_has_no_shift_to_publish(bare: Calibration, tmp_path: Path) -> None:
    bare.save(tmp_path / "bare")
    for form, lens in (("ros", "plumb_bob"), ("kalibr", "radtan"), ("colmap", "FULL_OPENCV")):
        text = export(tmp_path / "bare", tmp_path / form, form, lens, NAMES[form]).read_text()
        assert not any(word in text for word in ("static_transform", "[[1.0", "TX TY TZ"))


def polynomial(coefficients: list[float], phi: Array, theta: Array) -> Array:
    """eval_bivariate_poly of gsplat/cuda/_torch_external_distortion.py: Horner's scheme in phi,
    then in theta.
    """
    order = (-3 + int((1 + 8 * len(coefficients)) ** 0.5)) // 2
    outer, start = [], 0
    for inner in range(order, -1, -1):
        value = np.zeros_like(phi)
        for coefficient in reversed(coefficients[start : start + inner + 1]):
            value = value * phi + coefficient
        outer.append(value)
        start += inner + 1
    total = np.zeros_like(phi)
    for value in reversed(outer):
        total = total * theta + value
    return total


def turned(rays: Array, horizontal: list[float], vertical: list[float]) -> Array:
    """distort_camera_ray of the same file: (N, 3) rays to (N, 3) unit rays."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    phi, theta = np.arcsin(unit[:, 0]), np.arcsin(unit[:, 1])
    x = np.sin(polynomial(horizontal, phi, theta))
    y = np.sin(polynomial(vertical, phi, theta))
    return np.column_stack([x, y, np.sqrt(1 - x**2 - y**2)])


@pytest.mark.parametrize("lens", ["opencv-pinhole", "opencv-fisheye"])
def test_windshield(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """The readers are gsplat's reference of the model, in Python, and OpenCV's lens."""
    answer = json.loads(
        export(saved, tmp_path, "windshield", lens, "windshield_0.4m.json").read_text()
    )
    camera, text = answer["camera_model_parameters"], "\n".join(answer["refracal"])
    assert (answer["camera_model_type"], camera["resolution"], camera["shutter_type"]) == (
        lens,
        [WIDTH, HEIGHT],
        "GLOBAL",
    )
    glass = camera["external_distortion_parameters"]
    assert glass["reference_poly"] == "FORWARD"
    assert {
        len(values) for key, values in glass.items() if "_poly" in key and key != "reference_poly"
    } == {21}
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        inner = turned(points - centre(text), glass["horizontal_poly"], glass["vertical_poly"])
        slopes = inner[:, :2] / inner[:, 2:]
        k = camera["radial_coeffs"]
        if lens == "opencv-fisheye":
            assert np.arctan(np.linalg.norm(slopes, axis=-1)).max() < camera["max_angle"]
            bent = fisheye(slopes, k)
        else:
            assert camera["thin_prism_coeffs"] == [0.0] * 4
            bent = distorted(slopes, [*k[:2], *camera["tangential_coeffs"], *k[2:]])
        check_misfit(
            bent * camera["focal_length"] + camera["principal_point"] - (pixels + 0.5), rms, worst
        )
        if depth == DEPTH:  # and back: a ray's angle counts in px at the focal length
            outer = turned(inner, glass["horizontal_poly_inverse"], glass["vertical_poly_inverse"])
            towards = points - centre(text)
            angle = np.linalg.norm(
                np.cross(outer, towards / np.linalg.norm(towards, axis=-1, keepdims=True)), axis=-1
            )
            assert np.sqrt((angle**2).mean()) * camera["focal_length"][0] < 2 * rms + 0.01


@pytest.mark.parametrize("lens", ["opencv-pinhole", "opencv-fisheye"])
def test_windshield_by_ncore(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    reason = (
        "nvidia-ncore is not installed (pip install nvidia-ncore): NCore's own camera was not tried"
    )
    data = pytest.importorskip(f"ncore.{'data'}", reason=reason)
    sensors = pytest.importorskip(f"ncore.{'sensors'}", reason=reason)
    answer = json.loads(
        export(saved, tmp_path, "windshield", lens, "windshield_0.4m.json").read_text()
    )
    types = importlib.import_module("ncore.impl.data.types")
    camera = sensors.CameraModel.from_parameters(
        types.decode_camera_model_parameters(answer), device="cpu", dtype=torch.float64
    )
    assert isinstance(camera.get_parameters(), data.CameraModelParameters)
    text = "\n".join(answer["refracal"])
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        projection = camera.camera_rays_to_image_points(points - centre(text))
        in_picture = (
            projection.valid_flag.numpy()
        )  # what is projected beside the picture's edge is not
        assert in_picture.mean() > 0.99
        check_misfit((projection.image_points.numpy() - (pixels + 0.5))[in_picture], rms, worst)


def test_depthai(small: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The reader works as the device does: y and x every so many columns and rows, and between them
    linearly; they mean what cv2.remap's maps do.
    """
    small.save(tmp_path)
    assert (
        main(
            [
                "export",
                str(tmp_path),
                "--format",
                "depthai",
                "--depth",
                str(DEPTH),
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 0
    )
    (path,) = (tmp_path / "out").glob("mesh_*")
    width, height = small.camera.width, small.camera.height
    assert path.name == "mesh_0.4m_10x14.calib"
    columns, row_step = 10, 14
    assert (width % columns, height % row_step) == (0, 0)
    points = np.fromfile(path, np.float32).reshape(height // row_step + 1, width // columns + 1, 2)
    at = np.random.default_rng(2).uniform(30, [width - 30, height - 30], (500, 2))
    axes = np.arange(0, height + row_step, row_step), np.arange(0, width + columns, columns)
    sampled = RegularGridInterpolator(axes, points)(at[:, ::-1])[:, ::-1]
    k = small.camera.intrinsics
    assert k
    tangents = (at - [k.cx.value, k.cy.value]) / [k.fx.value, k.fy.value]
    error = np.linalg.norm(
        sampled - small.project(np.column_stack([tangents, np.ones(500)]) * DEPTH), axis=-1
    )
    stated = capsys.readouterr().err
    assert "setMeshStep(10, 14)" in stated
    worst = float(stated.split(" px at worst")[0].split()[-1])
    assert 0.3 * worst < error.max() < 1.2 * worst + 1e-3


@pytest.mark.parametrize("lens", ["radtan", "equidistant"])
def test_kalibr(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    text = export(saved, tmp_path, "kalibr", lens, "camchain_0.4m.yaml").read_text()
    camera = yaml.safe_load(text)["cam0"]
    assert (camera["camera_model"], camera["distortion_model"], camera["resolution"]) == (
        "pinhole",
        lens,
        [WIDTH, HEIGHT],
    )
    fu, fv, pu, pv = camera["intrinsics"]
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = (fisheye if lens == "equidistant" else distorted)(
            points[:, :2] / points[:, 2:], camera["distortion_coeffs"]
        )
        check_misfit(bent * [fu, fv] + [pu, pv] - pixels, rms, worst)


@pytest.mark.parametrize("lens", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_colmap(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """COLMAP counts pixels from the corner of the picture."""
    path = export(saved, tmp_path, "colmap", lens, "cameras_0.4m.txt")
    text = path.read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    (line,) = lines
    number, name, width, height, *params = line.split()
    assert (number, name, int(width), int(height)) == ("1", lens, WIDTH, HEIGHT)
    fx, fy, cx, cy, *coefficients = map(float, params)
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        points = points - centre(text)
        bent = (fisheye if lens == "OPENCV_FISHEYE" else distorted)(
            points[:, :2] / points[:, 2:], coefficients
        )
        check_misfit(bent * [fx, fy] + [cx, cy] - (pixels + 0.5), rms, worst)


@pytest.mark.parametrize("lens", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_colmap_by_pycolmap(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    pycolmap = pytest.importorskip(
        "pycolmap", reason="pycolmap is not installed: COLMAP's own reader was not tried"
    )
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
from calib.io.output_folder import LEDGER
model = mrcal.cameramodel(sys.argv[1])
points = np.array(json.load(sys.stdin))
seen = mrcal.project(mrcal.transform_point_rt(model.extrinsics_rt_fromref(), points), *model.intrinsics())
print(json.dumps({"pixels": seen.tolist(), "size": [int(n) for n in model.imagersize()], "model": model.intrinsics()[0]}))
"""  # noqa: E501
PYTHON = "/usr/bin/python3"


def has_mrcal() -> bool:
    return (
        Path(PYTHON).exists()
        and subprocess.run(
            [PYTHON, "-c", "import mrcal"], capture_output=True, check=False
        ).returncode
        == 0
    )


@pytest.mark.skipif(
    not has_mrcal(),
    reason="mrcal is not installed (apt-get install python3-mrcal): its reader was not tried",
)
@pytest.mark.parametrize("lens", ["OPENCV4", "OPENCV8", "OPENCV12", "SPLINED"])
def test_mrcal(covered: Calibration, saved: Path, tmp_path: Path, lens: str) -> None:
    """Points of the calibration's own camera frame: the extrinsics carry the shift."""
    path = export(saved, tmp_path, "mrcal", lens, "camera_0.4m.cameramodel")
    for depth, rms, worst in statements(path.read_text()):
        pixels, points = seen(covered, depth, 1000)
        command = [PYTHON, "-c", MRCAL, str(path)]
        done = subprocess.run(
            command, input=json.dumps(points.tolist()), capture_output=True, text=True, check=True
        )
        answer = json.loads(done.stdout)
        assert answer["model"].startswith(f"LENSMODEL_{lens}")
        assert answer["size"] == [WIDTH, HEIGHT]
        check_misfit(np.array(answer["pixels"]) - pixels, rms, worst)
