"""Sessions whose points are on no plane: a robot's cloud, or two planes at an angle."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml
from scipy.spatial.transform import Rotation

import calib
from calib.calibration import Calibration
from calib.cli import main
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.session.camera import Camera
from calib.session.freeing import free_parameters
from calib.session.numbers import numbers_of
from calib.session.point_target import PointTarget, in_space
from calib.session.session import read_session
from fixtures.calibrated import CAMERA
from fixtures.map_errors import error_over_sigma
from fixtures.point_sessions import (
    cloud,
    corner_of_planes,
    screen_scene,
    screen_views,
    spatial_scene,
    write_point_session,
)
from fixtures.synthetic import COVERS, HEIGHT, INTRINSICS, WIDTH, Scene, misdeclared
from fixtures.wide import CAMERA as WIDE_CAMERA
from fixtures.wide import INTRINSICS as WIDE

NOISE = 0.05
"""px per axis."""
VIEWS = 9
SEEDS = 12
PLACES = corner_of_planes()
LENS = np.array([-0.2, 0.08, 0.001, -0.0005, 0.0])
Floats = np.ndarray


@pytest.fixture(scope="module")
def made() -> Scene:
    return spatial_scene(3, VIEWS, PLACES)


@pytest.fixture(scope="module")
def session_folder(made: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session."""
    return write_point_session(tmp_path_factory.mktemp("space") / "s", made, NOISE)


@pytest.fixture(scope="module")
def fitted(session_folder: Path) -> Path:
    """The same with its calibration."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.report.write.DRAWINGS", ())
        assert main(["fit", str(session_folder), "--json"]) == 0
    return session_folder


def bare_points(
    places: Floats, views: int, seed: int = 1, noise: float = 0.1
) -> tuple[list[Floats], list[Floats]]:
    """Return the (n, 3) m places and (n, 2) px of a target that is turned to any side before a
    camera without a cover, by OpenCV's projection.
    """
    rng = np.random.default_rng(seed)
    k = INTRINSICS
    matrix = np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])
    objects: list[Floats] = []
    images: list[Floats] = []
    while len(objects) < views:
        shift = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.6, 1.0)])
        pixels = cv2.projectPoints(places, rng.normal(0, 1.2, 3), shift, matrix, LENS)[0][:, 0]
        pixels = pixels + rng.normal(0, noise, pixels.shape)
        visible = ((pixels > 0) & (pixels < [WIDTH - 1, HEIGHT - 1])).all(1)
        objects.append(places[visible])
        images.append(pixels[visible])
    return objects, images


def write_bare_session(
    folder: Path, objects: list[Floats], images: list[Floats], camera: Camera = CAMERA
) -> Path:
    """Write a session of a camera without a cover, whose intrinsics are unknown."""
    (folder / "points").mkdir(parents=True)
    document = {
        "format": 1,
        "target": {"type": "points"},
        "camera": {"width": camera.width, "height": camera.height},
        "cover": {"shape": "none"},
    }
    (folder / "session.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    for number, (target, pixels) in enumerate(zip(objects, images, strict=True)):
        covariance = np.tile(0.01 * np.eye(2), (len(pixels), 1, 1))
        np.savez(
            folder / "points" / f"{number:04d}.npz",
            pixels=pixels,
            target=target,
            covariance=covariance,
        )
    return folder


def deviations(calibration: Calibration) -> Floats:
    """Return the errors of the intrinsics over their sigmas. The lens may lack k3, which is 0."""
    lens = calibration.camera.intrinsics
    assert lens
    k = INTRINSICS
    true = [k.fx.value, k.fy.value, k.cx.value, k.cy.value, *LENS[: len(lens.distortion)]]
    numbers = [lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion]
    return np.array([(n.value - t) / n.sigma for n, t in zip(numbers, true, strict=True)])


@pytest.mark.parametrize(("places", "views"), [(PLACES, 6), (cloud(np.random.default_rng(0)), 1)])
def test_unknown_intrinsics_are_found(places: Floats, views: int, tmp_path: Path) -> None:
    """Several views of two planes, or a single one of a robot's cloud."""
    folder = write_bare_session(tmp_path / "s", *bare_points(places, views))
    calibration = fit(read_session(folder), Settings())
    assert np.abs(deviations(calibration)).max() < 2.5
    assert calibration.stages[-1].rms_px < 0.15


def test_arrays_in_space_are_calibrated(tmp_path: Path) -> None:
    """cv2.calibrateCamera needs a start for such points; the origin may be far away."""
    objects, images = bare_points(PLACES, 6, seed=2)
    objects = [places + np.array([3.0, 2.0, 1.0]) for places in objects]
    images[0][3] = np.nan
    calibration = calib.calibrate(objects, images, (WIDTH, HEIGHT))
    assert np.abs(deviations(calibration)).max() < 2.5
    calibration.save(tmp_path / "c")
    copy = Calibration.load(tmp_path / "c")
    assert [view.name for view in copy.views] == [f"view {index}" for index in range(6)]
    assert not copy.board.is_flat
    np.testing.assert_array_equal(copy.board.points(), calibration.board.points())


@pytest.mark.slow
def test_a_fisheye_is_found_from_one_view(tmp_path: Path) -> None:
    """The cloud lies to the right, up to 80 degrees from the axis."""
    path, values = pinhole_path(WIDE)
    places = cloud(np.random.default_rng(1), 300, 0.4)
    turn = Rotation.from_rotvec([0.4, -0.9, 0.2]).as_matrix()
    points = torch.from_numpy(places @ turn.T + [0.15, 0.0, 0.3])
    pixels = project(path, values, points, MIDDLE).numpy()
    visible = ((pixels > 2) & (pixels < [WIDE_CAMERA.width - 3, WIDE_CAMERA.height - 3])).all(1)
    pixels = pixels[visible] + np.random.default_rng(2).normal(0, 0.1, (visible.sum(), 2))
    folder = write_bare_session(tmp_path / "s", [places[visible]], [pixels], WIDE_CAMERA)
    lens = fit(read_session(folder), Settings()).camera.intrinsics
    assert lens
    assert lens.model == "fisheye"
    for number, true in zip(
        [lens.fx, lens.fy, lens.cx, lens.cy], [WIDE.fx, WIDE.fy, WIDE.cx, WIDE.cy], strict=True
    ):
        assert abs(number.value - true.value) < 2.5 * number.sigma


@pytest.mark.slow
def test_the_error_is_what_sigma_says(tmp_path: Path) -> None:
    """Domes and windows in water and uneven cones have declared numbers that are wrong by their
    tolerances.
    """
    normalised, of_maps = [], []
    for seed in range(SEEDS):
        cover, amplitude = COVERS[("wet-dome", "wet-flat", "uneven-cone")[seed % 3]]
        rng = np.random.default_rng(100 + seed)
        places = cloud(rng) if seed % 2 else PLACES
        made = spatial_scene(seed, VIEWS, places, cover, amplitude)
        declared = misdeclared(rng, INTRINSICS, cover)
        folder = write_point_session(tmp_path / str(seed), made, NOISE, seed, declared=declared)
        calibration = fit(read_session(folder), Settings())
        true = numbers_of(INTRINSICS, cover)
        assert calibration.camera.intrinsics
        numbers = numbers_of(calibration.camera.intrinsics, calibration.cover)
        errors = [(n.value - true[name].value) / n.sigma for name, n in numbers.items() if n.sigma]
        assert np.abs(errors).max() < 3.5
        assert np.mean(np.abs(errors) < 2.5) > 0.9
        normalised += errors
        of_maps.append(error_over_sigma(made, calibration))
    ratio = float(np.sqrt(np.mean(np.square(normalised))))
    print(f"numbers {ratio:.2f}, maps {np.sqrt(np.mean(np.square(of_maps))):.2f}")
    assert 0.8 < ratio < 1.25
    assert 0.8 < np.sqrt(np.mean(np.square(of_maps))) < 1.25


def test_a_flat_target_in_space_gives_the_same_numbers() -> None:
    """The planes through its points that face the camera tell what its own plane tells."""
    made = screen_scene(2, 4, 12, 8, amplitude=0.0)
    rng = np.random.default_rng(0)
    views = [
        replace(v, corners=v.corners + rng.normal(0, 0.1, v.corners.shape)) for v in made.views
    ]
    priors = priors_of(*free_parameters(INTRINSICS, made.cover, ("all",)), made.path)
    model = CameraModel(made.path, made.values, priors)
    flat = PointTarget.of(made.board.points())
    results = [
        model.fit(Observations.of(views, board), made.poses) for board in (flat, in_space(flat))
    ]
    for name, number in results[0].estimates().items():
        assert abs(results[1].estimates()[name].value - number.value) < 0.01 * number.sigma


@pytest.mark.slow
def test_points_in_space_through_the_commands(
    fitted: Path, made: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Other views of the target are evaluated and checked, and the maps are exported."""
    later = screen_views(np.random.default_rng(8), made, 4)
    held_out = str(write_point_session(tmp_path / "h", later, NOISE, seed=2))
    calibration = str(fitted / "calibration")
    assert not Calibration.load(calibration).board.is_flat
    capsys.readouterr()
    assert main(["evaluate", calibration, held_out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rms_px"] < 1.15 * 2**0.5 * NOISE
    assert main(["check", calibration, held_out]) == 0
    export = ["export", calibration, "--format", "npz", "--depth", "0.5", "-o", str(tmp_path / "e")]
    assert main(export) == 0


@pytest.mark.slow
def test_the_loop_finds_nothing(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Effects of a flat board are not tried."""
    capsys.readouterr()
    assert main(["diagnose", str(fitted / "calibration"), "-o", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["accepted"] == []
    tried = {candidate["effect"] for candidate in answer["candidates"]}
    assert tried
    assert not tried & {"board_shape", "board_scale", "board_flex", "free_field", "screen_glass"}


@pytest.mark.slow
def test_another_glass_is_degraded(fitted: Path, tmp_path: Path) -> None:
    other = write_point_session(tmp_path / "o", spatial_scene(4, 4, PLACES), NOISE, seed=2)
    assert main(["check", str(fitted / "calibration"), str(other)]) == 5


@pytest.mark.parametrize("effect", ["board_shape", "screen_glass"])
def test_effects_of_a_plane_are_refused(
    session_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], effect: str
) -> None:
    output = ["-o", str(tmp_path / "c")]
    assert main(["fit", str(session_folder), "--effects", effect, *output]) == 2
    words = (
        f"with points that are not all in the plane z = 0 there can be no {effect}: leave it out"
    )
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spoil", "status", "words"),
    [
        (lambda places: places * [1, 1, -1], 2, "its x, y and z are a left-handed system"),
        (lambda places: places * [1, 0, 0] + [0, 0, 0.1], 3, "that are seen lie on one line"),
        (lambda places: places[:7], 3, "only 7 points are seen, and a pose needs 8"),
    ],
    ids=["left-handed", "line", "few"],
)
def test_wrong_points_are_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spoil: Callable[[Floats], Floats],
    status: int,
    words: str,
) -> None:
    """Points are refused alike with known and with unknown intrinsics."""
    objects, images = bare_points(PLACES, 5)
    objects = [spoil(places) for places in objects]
    images = [pixels[: len(places)] for pixels, places in zip(images, objects, strict=True)]
    folder = write_bare_session(tmp_path / "s", objects, images)
    assert main(["fit", str(folder)]) == status
    assert words in capsys.readouterr().err
    document = yaml.safe_load((folder / "session.yaml").read_text())
    document["camera"]["intrinsics"] = {"fx": 2558, "fy": 2558, "cx": 1666, "cy": 1273}
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    assert main(["fit", str(folder)]) == status
    assert words in capsys.readouterr().err


def test_a_dense_view_in_space_is_thinned(tmp_path: Path) -> None:
    """Neighbours in the picture are not averaged: they may be far from each other."""
    objects, images = bare_points(cloud(np.random.default_rng(3), 900), 1)
    session = read_session(write_bare_session(tmp_path / "s", objects, images))
    (view,) = session.points
    assert len(view.pixels) == 600
    assert {tuple(row) for row in view.places} <= {tuple(row) for row in objects[0]}


@pytest.mark.slow
def test_flat_views_of_one_target_may_have_different_planes(tmp_path: Path) -> None:
    """A plate on a stage: each view has one height, and together they are in space."""
    flat = np.pad(PLACES[:, :2], ((0, 0), (0, 1)))
    objects, images = bare_points(flat, 8, seed=4)
    objects = [places + np.array([0, 0, 0.01 * number]) for number, places in enumerate(objects)]
    session = read_session(write_bare_session(tmp_path / "s", objects, images))
    assert not session.board.is_flat
    assert np.abs(deviations(fit(session, Settings()))).max() < 3
