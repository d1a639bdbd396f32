"""Calibmar and COLMAP's underwater fork: what their formulas make of the file is what the
calibration sees.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect
from calib.cli import main
from calib.effects.cover_offset import CoverOffset
from calib.effects.flat_port import FlatPort
from calib.effects.wedge import Wedge
from calib.optics.relief import Relief
from calib.session.cover import Cover
from calib.session.schema import Number
from tests.export.truth import LENS, distorted, port

Array = NDArray[np.float64]


def exported(calibration: Calibration, folder: Path) -> Path:
    calibration.save(folder / "saved")
    assert (
        main(["export", str(folder / "saved"), "--format", "calibmar", "-o", str(folder / "out")])
        == 0
    )
    return folder / "out" / "calibmar.yaml"


def refract(normal: Array, from_: float, to: float, direction: Array) -> Array:
    """ComputeRefraction of the fork, for one (3,) ray and the (3,) normal on its side."""
    ratio, cosine = from_ / to, float(normal @ direction)
    bent = ratio * direction + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
    return np.asarray(bent / np.linalg.norm(bent))


def colmap_ray(document: dict[str, list[float]], pixel: Array) -> tuple[Array, Array]:
    """CamFromImg of FlatPort and DomePort: the ray in water of one (2,) px, which counts from the
    picture's corner.
    """
    fx, fy, cx, cy, *lens = document["parameters"]
    goal = (pixel - [cx, cy]) / [fx, fy]
    slope = goal.copy()
    for _ in range(100):
        slope += goal - distorted(slope[None], lens)[0]
    direction = np.array([*slope, 1.0]) / np.linalg.norm([*slope, 1.0])
    x, y, z, reach, thickness, air, glass, water = document["non_svp_parameters"]
    place, origin = np.array([x, y, z]), np.zeros(3)
    for distance, from_, to in ((reach, air, glass), (reach + thickness, glass, water)):
        if document["non_svp_model"] == "FLATPORT":  # type: ignore[comparison-overlap]
            normal = place
            length = (distance - normal @ origin) / (normal @ direction)
        else:
            towards = origin - place
            half = towards @ direction
            length = -half + np.sqrt(half**2 - towards @ towards + distance**2)
        origin = origin + length * direction
        if document["non_svp_model"] == "DOMEPORT":  # type: ignore[comparison-overlap]
            normal = (origin - place) / np.linalg.norm(origin - place)
        direction = refract(normal, from_, to, direction)
    return origin, direction


def off(path: Path, calibration: Calibration, count: int = 2000) -> tuple[float, float]:
    """rad and m: the largest angle between what the file and the calibration see, and how far the
    one's start is from the other's ray.
    """
    document = yaml.safe_load(path.read_text())
    size = calibration.camera.width, calibration.camera.height
    pixels = np.random.default_rng(4).uniform(0, np.array(size) - 1, (count, 2))
    origins, directions = calibration.rays(pixels)
    rays = [colmap_ray(document, pixel + 0.5) for pixel in pixels]
    other_origins = np.array([origin for origin, _ in rays])
    other_directions = np.array([direction for _, direction in rays])
    angles = np.linalg.norm(np.cross(directions, other_directions), axis=-1)
    aside = np.linalg.norm(np.cross(other_origins - origins, directions), axis=-1)
    return float(angles.max()), float(aside.max())


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["flat", "dome"])
def test_a_port_is_exact_at_every_depth(
    shape: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = port(shape)
    path = exported(calibration, tmp_path)
    angle, aside = off(path, calibration)
    with capsys.disabled():
        print(f" {shape}: {angle:.1e} rad, {aside:.1e} m")
    assert angle < 1e-12
    assert aside < 1e-12
    text = path.read_text()
    assert text.count(": exact") == 4
    assert "Misfit" not in capsys.readouterr().err
    document = yaml.safe_load(text)
    assert (document["width"], document["height"]) == (
        calibration.camera.width,
        calibration.camera.height,
    )
    parameters = ", ".join(map(repr, document["parameters"]))
    refractive = ", ".join(map(repr, document["non_svp_parameters"]))
    assert (
        f'--ImageReader.camera_model {document["model"]} --ImageReader.camera_params "{parameters}"'
        in text
    )
    assert (
        f"--ImageReader.camera_refrac_model {document['non_svp_model']}"
        f' --ImageReader.camera_refrac_params "{refractive}"' in text
    )


def test_a_window_s_distance_is_along_its_normal(tmp_path: Path, flat: Calibration) -> None:
    x, y, z, reach, *_ = yaml.safe_load(exported(flat, tmp_path).read_text())["non_svp_parameters"]
    assert abs(np.linalg.norm([x, y, z]) - 1) < 1e-15
    assert abs(reach - flat.cover.parameters["distance"].value * z) < 1e-15


def _number(value: float) -> tuple[Array, Array]:
    return np.array(value), np.array(0.0)


def test_an_exported_port_includes_the_diagnosed_effects(tmp_path: Path, flat: Calibration) -> None:
    moved = replace(
        flat,
        effects=(
            AddedEffect(
                CoverOffset(("cover.distance",)), {"cover_offset.distance": _number(0.003)}
            ),
        ),
    )
    angle, aside = off(exported(moved, tmp_path), moved, 200)
    assert max(angle, aside) < 1e-12


def test_a_window_that_nobody_declared_is_a_port(tmp_path: Path, flat: Calibration) -> None:
    results = {
        "distance": 0.02,
        "tilt.x": 0.01,
        "tilt.y": -0.02,
        "thickness": 0.005,
        "outside_index": 1.335,
    }
    effect = AddedEffect(
        FlatPort("water"), {f"flat_port.{name}": _number(value) for name, value in results.items()}
    )
    undeclared = replace(flat, cover=Cover("none", {}), effects=(effect,))
    angle, aside = off(exported(undeclared, tmp_path), undeclared, 200)
    assert max(angle, aside) < 1e-12


@pytest.mark.parametrize("what", ["relief", "wedge"])
def test_numbers_that_a_port_cannot_hold_are_reported(
    what: str, tmp_path: Path, flat: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    if what == "relief":
        amplitudes = np.random.default_rng(3).normal(0, 3e-6, (4, 4))
        uneven = replace(
            flat, relief=Relief((-0.02, -0.025), (0.02, 0.025), (4, 4)), amplitudes=amplitudes
        )
    else:
        uneven = replace(
            flat,
            effects=(
                AddedEffect(Wedge("xy"), {"wedge.x": _number(1e-3), "wedge.y": _number(0.0)}),
            ),
        )
    path = exported(uneven, tmp_path)
    angle, _ = off(path, uneven, 500)
    stated = next(line for line in path.read_text().splitlines() if "at 3 m" in line)
    worst = float(stated.split(" px at worst")[0].split()[-1])
    assert "is left out" in stated
    assert worst > 0.1
    assert stated.removeprefix("# ") in capsys.readouterr().err
    focal = LENS.fx.value
    assert 0.3 * worst < angle * focal < 1.5 * worst  # 3 m away, an angle is what counts


def test_a_lens_that_colmap_lacks_is_fitted(tmp_path: Path, flat: Calibration) -> None:
    lens = replace(
        LENS,
        distortion=(
            *LENS.distortion,
            Number(0.0),
            Number(0.0),
            Number(0.0),
            Number(1e-3),
            Number(0.0),
            Number(-5e-4),
            Number(0.0),
        ),
    )
    prism = replace(flat, camera=replace(flat.camera, intrinsics=lens))
    text = exported(prism, tmp_path).read_text()
    assert "is left out" in text
