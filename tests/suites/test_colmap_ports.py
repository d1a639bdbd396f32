"""COLMAP Underwater's ports, compiled from its source as Calibmar carries it: for the ports of its
tests, its rays are ours, and so are its projections.

Source of the ports: models_refrac_test.cc of COLMAP Underwater, FlatPort.Nominal (its normal is
drawn at random; here it is written down) and DomePort.Case1 to Case3.
"""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.export.calibmar import Port, port_of
from calib.session.shapes.dome import DOME
from calib.session.shapes.flat import FLAT
from calib.session.shapes.shape import Shape
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from tests.suites.fetch import CALIBMAR

Array = NDArray[np.float64]

WIDTH, HEIGHT = 5568, 4176
"""px"""
LENS = (3200.484, 3200.917, 2790.172, 2108.726)
"""fx, fy, cx, cy in px, counted from the corner of the picture; without the distortion."""
PORTS = {
    "flat": (FLAT, 0.06, -0.08, np.sqrt(1 - 0.06**2 - 0.08**2), 0.05, 0.007, 1.003, 1.473, 1.333),
    "dome 1": (DOME, 0.00042007, 0.00366894, 0.0283927, 0.05, 0.007, 1.003, 1.473, 1.333),
    "dome 2": (DOME, 0.0342007, 0.0366894, 0.0083927, 0.1, 0.007, 1.003, 1.523, 1.333),
    "dome 3": (DOME, 0.0, 0.0, 0.0, 0.1, 0.007, 1.003, 1.523, 1.333),
}
"""The shape and COLMAP's parameters: the place, the reach, the thickness, and the indices of air,
glass and water.
"""
PRINTED_PIXELS = np.array([[300.0, 4000.0], [5000.0, 700.0]])
PRINTED_RAYS = {
    "flat": [
        [-0.046078874, 0.034874807, 0.062869856, -0.398783792, 0.291366715, 0.869526840],
        [0.035133199, -0.022507594, 0.053358865, 0.418975973, -0.278885200, 0.864107736],
    ],
    "dome 1": [
        [-0.042412135, 0.032014456, 0.053109778, -0.621281791, 0.450141496, 0.641390342],
        [0.040131966, -0.025771808, 0.056768881, 0.589959380, -0.397523040, 0.702796814],
    ],
    "dome 2": [
        [-0.054346255, 0.039531378, 0.068395699, -0.651544867, 0.317253540, 0.689085972],
        [0.056131107, -0.037386057, 0.082425693, 0.451270743, -0.452205721, 0.769327435],
    ],
    "dome 3": [
        [-0.059549901, 0.045221753, 0.076536281, -0.556541129, 0.422633208, 0.715292348],
        [0.057162609, -0.036435216, 0.082788351, 0.534229994, -0.340516039, 0.773722909],
    ],
}
"""The origins in m and the directions that the compiled program prints for two pixels."""
SHIMS = Path(__file__).with_name("colmap_ports")
MODEL = Path("colmap/sensor/models_refrac.h")
EIGENS = (
    CALIBMAR.packages_folder / "cmeel.prefix" / "include" / "eigen3",
    Path("/usr/include/eigen3"),
)

each_port = pytest.mark.parametrize("name", PORTS)


def calibration(name: str) -> Calibration:
    """Return the camera behind a port of their tests. Our indices are relative to the air."""
    shape, x, y, z, reach, thickness, air, glass, water = PORTS[name]
    port = Port(shape, (x, y, z), reach, thickness, glass / air, water / air)
    fx, fy, cx, cy = LENS
    bare = lens_alone(scene(1, views=1), WIDTH, HEIGHT, fx, fy, cx - 0.5, cy - 0.5)
    return replace(bare, cover=port.cover)


def to_ray(points: Array, origins: Array, directions: Array) -> Array:
    """Return the (N,) m from points to the lines of rays."""
    return np.asarray(np.linalg.norm(np.cross(points - origins, directions), axis=-1))


@each_port
def test_printed_rays(name: str) -> None:
    """The compiled program's rays of two pixels, where its source is not there."""
    origins, directions = calibration(name).rays(PRINTED_PIXELS - 0.5)
    printed = np.array(PRINTED_RAYS[name])
    assert np.abs(np.hstack([origins, directions]) - printed).max() < 1e-9, "the printed digits"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile their ports into a program that prints rays."""
    eigen = next((path for path in EIGENS if path.is_dir()), None)
    compiler = shutil.which("c++") or shutil.which("g++")
    if not CALIBMAR.folder.is_dir() or not eigen:
        pytest.skip(CALIBMAR.skipped)
    model = next(CALIBMAR.folder.glob(f"lib/**/{MODEL}"), None)
    assert model, f"Calibmar has no {MODEL} any more"
    if not compiler:
        pytest.skip("COLMAP's ports are C++: install a compiler, g++")
    path = tmp_path_factory.mktemp("colmap") / "rays"
    includes = [f"-I{folder}" for folder in (SHIMS, model.parents[2], eigen)]
    command = [compiler, "-std=c++17", "-O1", *includes, str(SHIMS / "rays.cc"), "-o", str(path)]
    subprocess.run(command, check=True)
    return path


def rays_by_colmap(program: Path, shape: Shape, parameters: Array, pixels: Array) -> Array:
    """Return the (N, 8) origin, direction and projection that the program prints."""
    lines = (" ".join(map(repr, map(float, (*parameters, *LENS, *pixel)))) for pixel in pixels)
    text = "".join(f"{shape.port} {line}\n" for line in lines)
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    return np.array(done.stdout.split(), float).reshape(-1, 8)


@each_port
def test_compiled_rays(program: Path, name: str) -> None:
    """Their parameters, and those that our export writes for the same camera."""
    camera = calibration(name)
    pixels = np.random.default_rng(7).uniform(0, (WIDTH, HEIGHT), (500, 2))
    origins, directions = camera.rays(pixels - 0.5)
    shape, *theirs = PORTS[name]
    for parameters in (np.array(theirs), np.array(port_of(camera).parameters)):
        rays = rays_by_colmap(program, shape, parameters, pixels)
        assert len(rays) == len(pixels)
        assert to_ray(rays[:, :3], origins, directions).max() < 1e-12, "m"
        assert np.abs(rays[:, 3:6] - directions).max() < 1e-12
        projected = camera.project(rays[:, :3] + rays[:, 3:6]) + 0.5
        assert np.abs(projected - rays[:, 6:]).max() < 1e-6, "px"
