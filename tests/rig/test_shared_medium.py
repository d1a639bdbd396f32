"""Cameras in the same water share its index: which cameras do, and the joint estimate."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.commands.rig_lines import rig_json
from calib.inference.calibration_model import full_model
from calib.optics.build import covered_path
from calib.rig.fit_rig import fit_rig
from calib.rig.layout import medium_name
from calib.rig.rig import Rig
from calib.rig.shared_medium import find_shared_media, shared_media, with_shared_media
from calib.session.cover import Cover
from calib.session.parameter_names import COVER
from calib.session.schema import Number
from fixtures.rigs import SimulatedRig, simulate_rig, with_declared_medium
from fixtures.synthetic import FLAT_PLACE, INTRINSICS, glass
from tests.rig.conftest import BOARD, EVEN

SEA = 1.340
FRESH = 1.333
RIGS = 6


def simulated(seed: int, names: tuple[str, ...] = ("left", "right")) -> SimulatedRig:
    """Return a rig in the sea whose sessions declare fresh water."""
    window = glass("flat", 0.006, outside_index=SEA, **FLAT_PLACE)
    rig = simulate_rig(seed, window, placements=14, amplitude=0.0, board=BOARD, names=names)
    return with_declared_medium(rig, Number(FRESH))


def count_numbers(rig: Rig) -> int:
    """Return how many numbers the cameras and their mountings have if they share none."""
    cameras = rig.calibrations.values()
    mountings = 6 * (len(cameras) - 1)
    return mountings + sum(camera.camera_model().parameters.count for camera in cameras)


def declaring(calibration: Calibration, medium: Number) -> Calibration:
    """Return a calibration whose fit had this index of what is outside, with its tolerance."""
    declared = calibration.declared
    cover = declared.cover.replace_medium(medium, None)
    return replace(calibration, stated=replace(declared, cover=cover))


@pytest.mark.parametrize(
    ("first", "second", "are_shared"),
    [
        (Number(FRESH, 0.004), Number(FRESH, 0.004), True),
        (Number(FRESH, 0.004), Number(SEA, 0.004), True),
        (Number(FRESH, 0.004), Number(1.345, 0.004), False),
        (Number(FRESH, 0.004), Number(FRESH, exact=True), False),
        (Number(FRESH, 0.004), Number(FRESH), False),
        (Number(1.0, 0.2), Number(1.2, 0.2), False),
        (Number(1.0003, 1e-4), Number(1.0002, 1e-4), True),
        (Number(1.17, 0.17, unknown=True), Number(1.17, 0.17, unknown=True), False),
    ],
    ids=["alike", "sea", "brine", "exact", "held", "air", "measured air", "unknown"],
)
def test_cameras_share_what_they_declare_alike(
    fitted: Rig, first: Number, second: Number, are_shared: bool
) -> None:
    calibrations = {
        "left": declaring(fitted.calibrations["left"], first),
        "right": declaring(fitted.calibrations["right"], second),
    }
    assert find_shared_media(calibrations, {}) == ({"right": "left"} if are_shared else {})
    assert not find_shared_media(calibrations, {"right": "left"}), "the cover shares it already"


def test_a_third_camera_elsewhere_keeps_its_index(fitted: Rig) -> None:
    media = {"a": 1.36, "b": FRESH, "c": 1.362, "d": 1.335}
    calibration = fitted.calibrations["left"]
    calibrations = {
        name: declaring(calibration, Number(index, 0.002)) for name, index in media.items()
    }
    assert find_shared_media(calibrations, {}) == {"c": "a", "d": "b"}


def test_the_tightest_declared_index_is_the_prior(fitted: Rig) -> None:
    """A contradicted one is not: its camera's widened prior stands for all."""
    name = COVER.outside_index
    loose = declaring(fitted.calibrations["left"], Number(FRESH, 0.004))
    measured = declaring(fitted.calibrations["right"], Number(1.335, 0.001))
    doubting = replace(loose, stated=replace(loose.declared, doubted=(name,)))
    for first, mean in ((loose, 1.335), (doubting, FRESH)):
        calibrations = {"left": first, "right": measured}
        models = {camera: full_model(c) for camera, c in calibrations.items()}
        shared = with_shared_media(models, calibrations, {"right": "left"})
        for camera, model in shared.items():
            assert float(model.means[name]) == mean
            expected = 0.001 if first is loose else models["left"].priors.sigmas[name]
            assert model.priors.sigmas[name] == expected
            unshared = {key: s for key, s in model.priors.sigmas.items() if key != name}
            assert unshared.items() <= models[camera].priors.sigmas.items()
    assert models["left"].priors.sigmas[name] > 0.004


def test_the_medium_is_outside_of_the_outermost_cover() -> None:
    inner = glass("flat", 0.002, **FLAT_PLACE)
    outer = glass("dome", 0.003, inner_radius=0.06, outside_index=FRESH)
    path, _ = covered_path(INTRINSICS, replace(inner, outer=outer))
    assert medium_name(path) == "cover2.outside_index"
    assert medium_name(covered_path(INTRINSICS, inner)[0]) == COVER.outside_index
    bare, _ = covered_path(INTRINSICS, Cover("none", {}))
    assert not medium_name(bare)


@pytest.fixture(scope="module")
def sea() -> SimulatedRig:
    return simulated(1, ("left", "right", "third"))


@pytest.fixture(scope="module")
def sea_rig(sea: SimulatedRig, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return fit_rig(sea.write(tmp_path_factory.mktemp("sea") / "rig"), EVEN)


def test_three_cameras_have_one_index(sea_rig: Rig, tmp_path: Path) -> None:
    indices = [calibration.cover.medium for calibration in sea_rig.calibrations.values()]
    assert indices[0] is not None
    assert all(index == indices[0] for index in indices)
    assert abs(indices[0].value - SEA) < 2.5 * indices[0].sigma < 0.002
    assert len(sea_rig.covariance) == count_numbers(sea_rig) - 2, "one number instead of three"
    (medium,) = shared_media(sea_rig)
    assert medium.cameras == ("left", "right", "third")
    assert str(medium).startswith("One index of water for left, right and third: 1.3")
    assert rig_json(sea_rig, 1.0)["shared_media"] == [medium.as_mapping()]
    loaded = Rig.load(sea_rig.save(tmp_path / "out").parent)
    assert loaded.media == {"right": "left", "third": "left"}
    pixels = sea_rig.project(np.array([[0.05, 0.02, 0.6], [-0.05, 0.01, 0.8]]))
    _, sigma = sea_rig.distances(pixels, [[0, 1]])
    _, loaded_sigma = loaded.distances(pixels, [[0, 1]])
    assert loaded_sigma == pytest.approx(sigma, rel=1e-9)


def test_cameras_in_air_share_no_index(tmp_path: Path) -> None:
    window = glass("flat", 0.006, **FLAT_PLACE)
    made = simulate_rig(4, window, placements=8, amplitude=0.0, board=BOARD)
    rig = fit_rig(made.write(tmp_path / "rig"), EVEN)
    assert not rig.media
    assert len(rig.covariance) == count_numbers(rig)
    assert not list(shared_media(rig))


def test_a_rig_written_before_media_were_shared_is_read(sea_rig: Rig, tmp_path: Path) -> None:
    """Its cameras have an index each, and so has its covariance."""
    old_rig = replace(sea_rig, media={}, covariance=np.eye(count_numbers(sea_rig)))
    file = old_rig.save(tmp_path / "out")
    text = file.read_text()
    assert "shared_medium: {}\n" in text
    file.write_text(text.replace("shared_medium: {}\n", ""))
    assert not Rig.load(file).media


@pytest.mark.slow
def test_lengths_in_the_sea_are_as_sure_as_stated(tmp_path: Path) -> None:
    """Over several rigs, the errors of index and lengths are those of their sigmas."""
    squares = []
    deviations = []
    for seed in range(RIGS):
        made = simulated(seed)
        rig = fit_rig(made.write(tmp_path / str(seed)), EVEN)
        index = rig.calibrations["left"].cover.medium
        assert index
        deviations.append((index.value - SEA) / index.sigma)
        points, pixels = made.points(100 + seed, 200)
        pairs = np.arange(200).reshape(-1, 2)
        true = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=-1)
        length, sigma = rig.distances(pixels, pairs, 0.0)
        squares.append(np.mean(((length - true) / sigma) ** 2))
    assert np.abs(deviations).max() < 2.5
    assert 0.8 < np.sqrt(np.mean(squares)) < 1.25
