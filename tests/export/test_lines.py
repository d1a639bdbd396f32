"""Formats that hold the line of every pixel, read by their published formulas: the ray image and
the generic model.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.cli import main
from calib.io.output_folder import LEDGER
from calib.session.cover import Cover
from calib.session.schema import Number

Array = NDArray[np.float64]
DEPTHS = (0.1, 0.4, 2.0)


def export(calibration: Calibration, folder: Path, *words: str) -> Path:
    calibration.save(folder / "saved")
    assert (
        main(["export", str(folder / "saved"), "--format", *words, "-o", str(folder / "out")]) == 0
    )
    paths = [path for path in (folder / "out").iterdir() if path.name != LEDGER]
    (path,) = paths
    return path


def at(depth: float, origins: Array, directions: Array) -> Array:
    """(N, 3) m: where rays are at depth m."""
    return np.asarray(origins + directions * ((depth - origins[:, 2:]) / directions[:, 2:]))


@pytest.mark.parametrize("axes", ["opencv", "opengl"])
def test_a_ray_image_hits_the_points_that_its_pixels_see(
    small: Calibration, tmp_path: Path, axes: str
) -> None:
    """OpenGL's camera is OpenCV's, turned by half a turn about x, and so looks along -z."""
    path = export(small, tmp_path, "ray-image", "--axes", axes)
    assert path.name == ("ray_image.npy" if axes == "opencv" else "ray_image_opengl.npy")
    rays = np.load(path)
    width, height = small.camera.width, small.camera.height
    assert (rays.shape, rays.dtype) == ((height, width, 2, 3), np.float32)
    assert (np.sign(rays[..., 1, 2]) == (1 if axes == "opencv" else -1)).all()
    half_turn = np.eye(3) if axes == "opencv" else np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    pixels = np.random.default_rng(1).integers(0, [width, height], (500, 2))
    origins = rays[pixels[:, 1], pixels[:, 0], 0].astype(np.float64) @ half_turn
    directions = rays[pixels[:, 1], pixels[:, 0], 1].astype(np.float64) @ half_turn
    assert np.abs(np.linalg.norm(directions, axis=-1) - 1).max() < 1e-6
    for depth in DEPTHS:
        assert np.abs(small.project(at(depth, origins, directions)) - pixels).max() < 2e-3


def test_a_pixel_that_sees_nothing_has_no_ray(small: Calibration, tmp_path: Path) -> None:
    """A window that is slanted so much that one side of a wide picture sees past it."""
    numbers = {
        "distance": 0.02,
        "tilt.x": 0.0,
        "tilt.y": 0.75,
        "thickness": 0.003,
        "refractive_index": 1.5,
        "outside_index": 1.0,
    }
    tilted = replace(
        small,
        cover=Cover("flat", {name: Number(value) for name, value in numbers.items()}),
        relief=None,
        amplitudes=np.zeros((0, 0)),
        views=(),
        poses=np.zeros((0, 6)),
    )
    assert tilted.camera.intrinsics
    focal = replace(tilted.camera.intrinsics, fx=Number(200.0), fy=Number(200.0))
    wide = replace(tilted, camera=replace(tilted.camera, intrinsics=focal))
    rays = np.load(export(wide, tmp_path, "ray-image"))
    pixels = np.stack(
        np.meshgrid(
            *(np.arange(size, dtype=np.float64) for size in (wide.camera.width, wide.camera.height))
        ),
        -1,
    )
    origins, _ = wide.rays(pixels.reshape(-1, 2))
    no_ray = np.isnan(origins).any(-1).reshape(rays.shape[:2])
    assert 0 < no_ray.sum() < no_ray.size
    assert np.array_equal(np.isnan(rays).any((2, 3)), no_ray)


class Generic:
    """NoncentralGenericCamera of generic_models/src: its file, read character by character as
    there, and Unproject.
    """

    def __init__(self, path: Path) -> None:
        document: dict[str, str] = {}
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith("#"):
                key, value = line.replace(" ", "").split(":")
                document[key] = value
        assert document.pop("type") == "NoncentralGenericModel"
        grids = {
            key: np.array([float(word) for word in document.pop(key).strip("[]").split(",")])
            for key in ("point_grid", "direction_grid")
        }
        self.number = {key: int(value) for key, value in document.items()}
        shape = self.number["grid_height"], self.number["grid_width"], 3
        self.points = grids["point_grid"].reshape(shape)
        self.directions = grids["direction_grid"].reshape(shape)
        self.directions /= np.linalg.norm(self.directions, axis=-1, keepdims=True)

    def unproject(self, pixel: Array) -> tuple[Array, Array]:
        """A point of the line and its unit direction, of (2,) px from the picture's corner."""
        place = []
        for axis, size in zip("xy", ("grid_width", "grid_height"), strict=True):
            low, high = (
                self.number[f"calibration_min_{axis}"],
                self.number[f"calibration_max_{axis}"],
            )
            value = pixel["xy".index(axis)]
            assert low <= value < high + 1
            place.append(1 + (self.number[size] - 3) * (value - low) / (high + 1 - low) + 2)
        ix, wx = self.weights(place[0])
        iy, wy = self.weights(place[1])
        weights = wy[:, None, None] * wx[:, None]
        point = (weights * self.points[iy - 3 : iy + 1, ix - 3 : ix + 1]).sum((0, 1))
        direction = (weights * self.directions[iy - 3 : iy + 1, ix - 3 : ix + 1]).sum((0, 1))
        return point, direction / np.linalg.norm(direction)

    @staticmethod
    def weights(place: float) -> tuple[int, Array]:
        """EvalUniformCubicBSpline."""
        index = int(place)
        x = place - (index - 3)
        a = -1 / 6 * (x - 4) ** 3
        b = x**3 / 2 - 11 / 2 * x**2 + 39 / 2 * x - 131 / 6
        c = -(x**3) / 2 + 5 * x**2 - 16 * x + 50 / 3
        return index, np.array([a, b, c, (x - 3) ** 3 / 6])


def test_the_generic_model_s_lines_are_the_calibration_s(
    covered: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = export(covered, tmp_path, "generic")
    model = Generic(path)
    width, height = covered.camera.width, covered.camera.height
    assert (model.number["width"], model.number["height"]) == (width, height)
    edges = [[0.0, 0.0], [width - 1e-6, 0.0], [0.0, height - 1e-6], [width - 1e-6, height - 1e-6]]
    pixels = np.vstack([np.random.default_rng(2).uniform(0, [width, height], (1000, 2)), edges])
    lines = [model.unproject(pixel) for pixel in pixels]
    points = np.array([point for point, _ in lines])
    directions = np.array([direction for _, direction in lines])
    assert "Misfit" not in capsys.readouterr().err
    worst = 0.0
    for depth in DEPTHS:
        error = np.linalg.norm(
            covered.project(at(depth, points, directions)) - (pixels - 0.5), axis=-1
        )
        worst = max(worst, error.max())
        assert error.max() < 0.01
    with capsys.disabled():
        print(f" up to {worst:.4f} px")


def test_the_control_points_of_the_directions_are_unit_vectors(
    small: Calibration, tmp_path: Path
) -> None:
    """Readers normalise them, which must change nothing."""
    text = export(small, tmp_path, "generic").read_text()
    lines = [line for line in text.splitlines() if line.startswith("direction_grid")]
    (line,) = lines
    vectors = np.array(
        [float(word) for word in line.split(":")[1].strip(" []").split(",")]
    ).reshape(-1, 3)
    assert np.abs(np.linalg.norm(vectors, axis=-1) - 1).max() < 1e-12
