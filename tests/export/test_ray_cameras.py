"""Cameras for renderers: their rays by the formats' own rules, and a picture where Mitsuba is
installed.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from tests.export.test_lines import at
from tests.export.truth import centre, check_misfit, distorted, seen, statements


def export(calibration: Calibration, folder: Path, *words: str) -> Path:
    calibration.save(folder / "saved")
    saved, out = str(folder / "saved"), str(folder / "out")
    assert main(["export", saved, "--format", *words, "-o", out]) == 0
    return folder / "out"


def some_pixels(calibration: Calibration) -> np.ndarray:
    size = [calibration.camera.width, calibration.camera.height]
    return np.random.default_rng(1).integers(0, size, (300, 2))


def test_gsplat_s_rays_see_what_the_pixels_see(small: Calibration, tmp_path: Path) -> None:
    rays = np.load(export(small, tmp_path, "gsplat") / "gsplat_rays.npy")
    assert rays.shape == (1, small.camera.height, small.camera.width, 6)
    assert rays.dtype == np.float32
    pixels = some_pixels(small)
    chosen = rays[0, pixels[:, 1], pixels[:, 0]].astype(np.float64)
    points = at(0.5, chosen[:, :3], chosen[:, 3:])
    assert np.abs(small.project(points) - pixels).max() < 2e-3


def test_blender_s_textures_see_what_the_pixels_see(small: Calibration, tmp_path: Path) -> None:
    """The shader reads the texture at the raster's place, whose y runs upwards."""
    out = export(small, tmp_path, "blender")
    origin = cv2.imread(str(out / "ray_origin.tiff"), cv2.IMREAD_UNCHANGED)
    towards = cv2.imread(str(out / "ray_direction.tiff"), cv2.IMREAD_UNCHANGED)
    assert origin is not None
    assert towards is not None
    height, width = small.camera.height, small.camera.width
    assert origin.shape == towards.shape == (height, width, 4)
    assert (towards[..., 3] == 1).all()
    pixels = some_pixels(small)
    raster = (pixels + 0.5) / [width, height] * [1, -1] + [0, 1]
    column = np.floor(raster[:, 0] * width).astype(int)
    row = np.floor((1 - raster[:, 1]) * height).astype(int)
    up_to_down = np.array([1.0, -1.0, 1.0])
    origins = origin[row, column, 2::-1].astype(np.float64) * up_to_down
    directions = towards[row, column, 2::-1].astype(np.float64) * up_to_down
    assert np.abs(small.project(at(0.5, origins, directions)) - pixels).max() < 2e-3
    shader = (out / "refracal_camera.osl").read_text()
    for name in ("position", "direction", "throughput", "camera_shader_raster_position"):
        assert name in shader


@pytest.mark.parametrize("form", ["nerfstudio", "photonvision"])
def test_json_cameras_reproject_to_their_misfit(
    covered: Calibration, tmp_path: Path, form: str
) -> None:
    lens = "OPENCV" if form == "nerfstudio" else "5"
    out = export(covered, tmp_path, form, "--lens", lens, "--depth", "0.4")
    (path,) = out.glob("*.json")
    camera = json.loads(path.read_text())
    if form == "nerfstudio":
        assert (camera["w"], camera["h"]) == (covered.camera.width, covered.camera.height)
        matrix = np.array([camera["fl_x"], camera["fl_y"], camera["cx"], camera["cy"]])
        coefficients = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
        corner = 0.5
    else:
        assert camera["resolution"]["width"] == covered.camera.width
        matrix = np.array(camera["cameraIntrinsics"]["data"])[[0, 4, 2, 5]]
        coefficients = camera["distCoeffs"]["data"][:5]
        assert camera["distCoeffs"]["cols"] == 8
        corner = 0.0
    text = "\n".join(camera["refracal"])
    for depth, rms, worst in statements(text):
        pixels, points = seen(covered, depth)
        inside = points - centre(text)
        bent = distorted(inside[:, :2] / inside[:, 2:], coefficients)
        check_misfit(bent * matrix[:2] + matrix[2:] - (pixels + corner), rms, worst)


@pytest.mark.slow
def test_mitsuba_sees_what_it_sees_through_the_glass(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install -e '.[render]'")
    from fixtures.ray_cameras import difference, mitsuba_pictures, true_calibration

    out = export(true_calibration(), tmp_path, "mitsuba")
    picture, glass = mitsuba_pictures(out)
    assert np.linalg.norm(difference(picture, glass), axis=-1).max() < 0.02
