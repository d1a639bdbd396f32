"""A session that names a fleet's prior: read, compared with what it declares itself, and joined
with what it knows of its camera.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.errors import InputError
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.fleet_prior import (
    FleetPrior,
    check_compatible,
    combine_with_prior,
    fleet_prior_yaml,
    read_fleet_prior,
)
from calib.session.freeing import ALL, free_parameters
from calib.session.glass import Glass
from calib.session.numbers import covariance_of, numbers_of, replace_covariance
from calib.session.schema import Number
from calib.session.session import read_session, session_to_yaml
from fixtures.fleet import BOARD
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, paper_cone

CONE = paper_cone()
DECLARED = free_parameters(INTRINSICS, CONE, (ALL,))
NAMES = tuple(name for name, number in numbers_of(*DECLARED).items() if number.sigma)
COEFFICIENTS = 3
THICKNESS, FX = NAMES.index("cover.thickness"), NAMES.index("camera.fx")


def covariance() -> np.ndarray:
    """(K + N,) of numbers and glass, all correlated; a tenth of the tolerances."""
    rng = np.random.default_rng(0)
    count = len(NAMES) + COEFFICIENTS
    mixed = rng.normal(size=(count, count)) + 3 * np.eye(count)
    size = np.array(
        [*(0.1 * numbers_of(*DECLARED)[name].sigma for name in NAMES), *[1e-6] * COEFFICIENTS]
    )
    result = mixed @ mixed.T
    scale = size / np.sqrt(result.diagonal())
    return np.asarray(result * scale[:, None] * scale)


@pytest.fixture(scope="module")
def prior() -> FleetPrior:
    joint_covariance, count = covariance(), len(NAMES)
    mean = np.array([numbers_of(*DECLARED)[name].value for name in NAMES])
    intrinsics, cover = replace_covariance(
        INTRINSICS, CONE, NAMES, mean, joint_covariance[:count, :count]
    )
    glass = Glass(
        (-0.01, -0.3),
        (0.01, 0.3),
        1,
        np.array([1e-6, 2e-6, 3e-6]),
        joint_covariance[count:, count:],
        NAMES,
        joint_covariance[count:, :count],
    )
    camera = Camera(WIDTH, HEIGHT, intrinsics=intrinsics)
    return FleetPrior(
        Path("prior.yaml"),
        "",
        camera,
        replace(cover, glass=glass),
        DECLARED,
        8,
        (("A7", "its verdict is not to use it"),),
    )


def told(intrinsics: Intrinsics, cover: Cover) -> np.ndarray:
    glass = cover.glass
    assert glass
    matrix = covariance_of(intrinsics, cover, NAMES)
    cross_covariance = np.stack(
        [
            glass.cross_covariance[:, glass.numbers.index(name)]
            if name in glass.numbers
            else 0 * glass.mean
            for name in NAMES
        ],
        1,
    )
    return np.block([[matrix, cross_covariance.T], [cross_covariance, glass.covariance]])


def test_a_prior_is_read_as_it_was_written(prior: FleetPrior, tmp_path: Path) -> None:
    file = tmp_path / "prior.yaml"
    file.write_text(fleet_prior_yaml(prior, "0"))
    read = read_fleet_prior(file)
    assert (read.cameras, read.left_out, read.names) == (8, prior.left_out, NAMES)
    assert read.intrinsics == prior.intrinsics
    assert read.cover.parameters == prior.cover.parameters
    assert told(read.intrinsics, read.cover) == pytest.approx(covariance(), rel=1e-9, abs=0)
    assert read.cover.glass is not None
    assert read.cover.glass.mean == pytest.approx([1e-6, 2e-6, 3e-6])
    assert len(read.sha256) == 64


def test_plain_numbers_give_way_to_the_fleets(prior: FleetPrior) -> None:
    """The fleet's fits have already used the numbers of the drawing."""
    combined = combine_with_prior(prior, INTRINSICS, CONE, "session.yaml")
    assert told(*combined) == pytest.approx(covariance(), rel=1e-9, abs=0)


def with_thickness(number: Number) -> Cover:
    return replace(CONE, parameters={**CONE.parameters, "thickness": number})


def test_a_measurement_of_this_camera_is_combined_with_the_prior(prior: FleetPrior) -> None:
    """Oracle: information adds."""
    sigma = float(np.sqrt(covariance()[THICKNESS, THICKNESS]))
    combined = combine_with_prior(
        prior,
        INTRINSICS,
        with_thickness(Number(CONE.parameters["thickness"].value + sigma, sigma)),
        "session.yaml",
    )
    information = np.linalg.inv(covariance())
    information[THICKNESS, THICKNESS] += sigma**-2
    posterior = np.linalg.inv(information)
    assert told(*combined) == pytest.approx(posterior, rel=1e-6, abs=1e-9 * np.abs(posterior).min())
    score = np.zeros(len(posterior))
    score[THICKNESS] = 1 / sigma
    moved = posterior @ score
    assert numbers_of(*combined)["camera.fx"].value - INTRINSICS.fx.value == pytest.approx(
        moved[FX]
    )
    assert combined[1].glass is not None
    assert combined[1].glass.mean == pytest.approx(
        np.array([1e-6, 2e-6, 3e-6]) + moved[-COEFFICIENTS:]
    )


def test_numbers_that_the_fleet_declared_are_not_counted_twice(
    prior: FleetPrior,
) -> None:
    same = with_thickness(DECLARED[1].parameters["thickness"])
    assert told(*combine_with_prior(prior, INTRINSICS, same, "session.yaml")) == pytest.approx(
        covariance(), rel=1e-9, abs=0
    )


def test_an_exact_number_is_held_and_shifts_correlated_ones(prior: FleetPrior) -> None:
    sigma = float(np.sqrt(covariance()[THICKNESS, THICKNESS]))
    exact = Number(CONE.parameters["thickness"].value + sigma, exact=True)
    intrinsics, cover = combine_with_prior(prior, INTRINSICS, with_thickness(exact), "session.yaml")
    assert cover.parameters["thickness"] == exact
    joint_covariance = covariance()
    gain = joint_covariance[FX, THICKNESS] / joint_covariance[THICKNESS, THICKNESS]
    assert intrinsics.fx.value - INTRINSICS.fx.value == pytest.approx(gain * sigma)
    assert intrinsics.fx.sigma**2 == pytest.approx(
        joint_covariance[FX, FX] - gain * joint_covariance[FX, THICKNESS]
    )
    assert cover.glass is not None
    assert "cover.thickness" not in cover.glass.numbers


@pytest.mark.parametrize(
    ("camera", "cover", "message"),
    [
        (
            Camera(WIDTH // 2, HEIGHT // 2, intrinsics=INTRINSICS),
            CONE,
            "camera is 1640x1232 px: write 3280x2464, as prior.yaml is of such",
        ),
        (
            Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS),
            Cover("none", {}),
            "cover.shape is none: write cone",
        ),
        (
            Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS),
            replace(CONE, outer=CONE),
            "cover is a cone and a cone: write a cone, as prior.yaml is of such",
        ),
        (
            Camera(WIDTH, HEIGHT, intrinsics=replace(INTRINSICS, distortion=(Number(-0.1),) * 5)),
            CONE,
            "camera.intrinsics is opencv with 5 coefficients: write opencv with 0",
        ),
        (
            Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS),
            paper_cone(thickness=0.006),
            "cover.thickness is 0.006 where the cameras of prior.yaml have 0.003",
        ),
    ],
    ids=["mode", "shape", "covers", "lens", "another glass"],
)
def test_a_camera_of_another_make_is_refused(
    prior: FleetPrior, camera: Camera, cover: Cover, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        check_compatible(prior, camera, cover, "session.yaml")


def test_a_measurement_that_cannot_be_of_this_fleet_is_refused(prior: FleetPrior) -> None:
    with pytest.raises(
        InputError,
        match=(
            r"cover.thickness is 0.004 where .* standard deviations apart: correct it, or drop the"
            r" key prior"
        ),
    ):
        combine_with_prior(prior, INTRINSICS, with_thickness(Number(0.004, 1e-5)), "session.yaml")


def session(folder: Path, **entries: object) -> Path:
    document = {
        "format": 1,
        **session_to_yaml(BOARD, Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS), CONE),
        "corners": "corners.vnl",
    }
    (folder / "corners.vnl").write_text("# filename x y level\n")
    (folder / "session.yaml").write_text(yaml.safe_dump(document | entries))
    return folder


def test_a_session_names_it_from_its_own_folder_on(prior: FleetPrior, tmp_path: Path) -> None:
    (tmp_path / "prior.yaml").write_text(fleet_prior_yaml(prior, "0"))
    (tmp_path / "new").mkdir()
    read = read_session(session(tmp_path / "new", prior="../prior.yaml"))
    assert read.prior is not None
    assert read.prior.cameras == 8


@pytest.mark.parametrize(
    ("spoil", "document"),
    [
        (
            None,
            "prior names .* which is not a file: write it by calib fleet-prior, or drop the key",
        ),
        ({"format": 2}, "format is 2: write 1"),
        ({"cameras": 0}, "cameras is 0: write a whole number"),
        ({"camras": 3}, r"camras is not a known key \(did you mean cameras\?\)"),
        ({"left_out": [3]}, "left_out is a list of 1: write a list of {camera"),
        ({"declared": {}}, "declared.cover is missing"),
    ],
)
def test_a_file_that_is_no_prior_is_refused(
    prior: FleetPrior, tmp_path: Path, spoil: dict[str, object] | None, document: str
) -> None:
    if spoil is not None:
        written = yaml.safe_load(fleet_prior_yaml(prior, "0"))
        (tmp_path / "prior.yaml").write_text(yaml.safe_dump(written | spoil))
    with pytest.raises(InputError, match=document):
        read_session(session(tmp_path, prior="prior.yaml"))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("mean_um", [0, 0], "mean_um is a list of 2: write 3 numbers"),
        (
            "covariance_um2",
            [[1], [0, 1], [0, 0, -1]],
            "glass is a mapping: write correlations that are possible together",
        ),
        ("covariance_um", {"cover.thicknes": [0, 0, 0]}, "names of existing numbers"),
        ("high", [-1, 1], "two numbers, each above that of low"),
        ("degree", 99, "degree is 99: write a whole number from 0 to 10"),
    ],
)
def test_impossible_glass_is_refused(
    prior: FleetPrior, tmp_path: Path, key: str, value: object, message: str
) -> None:
    written = yaml.safe_load(fleet_prior_yaml(prior, "0"))
    written["cover"]["glass"][key] = value
    (tmp_path / "prior.yaml").write_text(yaml.safe_dump(written))
    with pytest.raises(InputError, match=message):
        read_session(session(tmp_path, prior="prior.yaml"))


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([["cover.thickness", "camera.fx"]], "two names and a number from -1 to 1 for each pair"),
        (
            [["cover.thickness", "camera.f", 0.5]],
            "names of existing numbers: cover.inner_radius",
        ),
        ([["camera.fx", "camera.fy", 0.5]], "the camera's own are in camera.intrinsics"),
        ([["cover.thickness", "camera.fx", 1.0]], "positive definite"),
    ],
)
def test_impossible_correlations_of_a_cover_are_refused(
    tmp_path: Path, pairs: object, message: str
) -> None:
    folder = session(tmp_path)
    written = yaml.safe_load((folder / "session.yaml").read_text())
    written["cover"]["correlations"] = pairs
    (folder / "session.yaml").write_text(yaml.safe_dump(written))
    with pytest.raises(InputError, match=message):
        read_session(folder)
