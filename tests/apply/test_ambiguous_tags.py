"""A small tag that is seen from the front may have either of two poses: pictures of a bare camera,
made by a homography.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from calib.apply.located_tags import LocatedTags
from calib.apply.tags import TagLocator
from calib.calibration import Calibration
from calib.cli import main
from fixtures.known import lens_alone
from fixtures.synthetic import scene

Array = NDArray[np.float64]

WIDTH, HEIGHT, FOCAL = 320, 240, 500.0
SIDE = 0.05
CELLS = 6
STRATA = 8
NOISE = 8.0
"""Grey levels."""
MATRIX = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return lens_alone(scene(1, views=1), WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)


def sharp(turn: Array, shift: Array) -> Array:
    """(HEIGHT, WIDTH) grey levels of a tag on a white sheet, by asking where STRATA^2 points of
    each pixel lie on it.
    """
    marker = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(3, CELLS)
    sheet = np.pad(marker, 1, constant_values=255)
    x = (np.arange(WIDTH * STRATA) + 0.5) / STRATA - 0.5
    y = (np.arange(HEIGHT * STRATA) + 0.5) / STRATA - 0.5
    rays = (
        np.stack([*np.meshgrid(x, y), np.ones((HEIGHT * STRATA, WIDTH * STRATA))], -1)
        @ np.linalg.inv(MATRIX).T
    )
    normal = turn[:, 2]
    points = rays * ((normal @ shift) / (rays @ normal))[..., None] - shift
    cell = np.floor(points @ turn[:, :2] / SIDE * CELLS + len(sheet) / 2).astype(int)
    is_on_sheet = np.all((cell >= 0) & (cell < len(sheet)), axis=-1, keepdims=True)
    cell = np.where(is_on_sheet, cell, 0)
    light = np.where(is_on_sheet[..., 0], 25 + sheet[cell[..., 1], cell[..., 0]] / 255 * 165, 80.0)
    blurred: Array = gaussian_filter(light, 0.6 * STRATA)
    return np.asarray(blurred.reshape(HEIGHT, STRATA, WIDTH, STRATA).mean((1, 3)))


def noisy(light: Array, seed: int) -> NDArray[np.uint8]:
    return np.clip(
        np.rint(light + np.random.default_rng(seed).normal(0, NOISE, light.shape)), 0, 255
    ).astype(np.uint8)


def at(degrees: float, depth: float) -> tuple[Array, Array]:
    turn = Rotation.from_rotvec(
        np.deg2rad(degrees) * np.array([0.6, -0.8, 0])
    ) * Rotation.from_rotvec([0, 0, 0.3])
    return turn.as_matrix(), np.array([0.01, -0.02, depth])


def located(
    calibration: Calibration, degrees: float, depth: float, repeats: int
) -> list[LocatedTags]:
    light = sharp(*at(degrees, depth))
    locator = TagLocator(calibration, "DICT_4X4_50", SIDE, side_sigma=0.0)
    return [locator.locate(noisy(light, seed)) for seed in range(repeats)]


@pytest.mark.slow
def test_poses_are_right_as_often_as_their_probability_states(calibration: Calibration) -> None:
    turn, shift = at(5, 1.0)
    right, stated, decided = 0.0, 0.0, 0
    for item in located(calibration, 5, 1.0, 80):
        (tag,) = item.tags
        decided += tag.ambiguous
        best = tag.poses[0]
        stated += best.probability
        # the other pose is turned by about 10 degrees
        right += Rotation.from_matrix(best.turn @ turn.T).magnitude() < np.deg2rad(5)
        nearest = min(
            tag.poses, key=lambda pose: Rotation.from_matrix(pose.turn @ turn.T).magnitude()
        )
        assert np.linalg.norm(nearest.position - shift) < 6 * np.linalg.norm(nearest.sigma[3:])
    assert decided > 40
    assert abs(right - stated) < 3 * np.sqrt(80 * 0.2), (
        "of 80 choices as many are right as they are said to be"
    )


@pytest.mark.slow
def test_sigma_equals_the_scatter_over_repeated_noise(calibration: Calibration) -> None:
    turn, shift = at(35, 0.4)
    poses = [item.tags[0].poses[0] for item in located(calibration, 35, 0.4, 80)]
    error = np.array(
        [
            [*Rotation.from_matrix(pose.turn @ turn.T).as_rotvec(), *(pose.position - shift)]
            for pose in poses
        ]
    )
    chi2 = (
        np.mean(
            [
                item @ np.linalg.solve(pose.covariance, item)
                for item, pose in zip(error, poses, strict=True)
            ]
        )
        / 6
    )
    assert (
        0.7 < chi2 < 1.4
    )  # 480 numbers scatter by 6 %; the noise is estimated, and rounding and strata come on top
    assert not any(item.tags[0].ambiguous for item in located(calibration, 35, 0.4, 3))


def test_the_command_prints_both_poses(
    calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light = sharp(*at(5, 1.0))
    picture = tmp_path / "front.png"
    cv2.imwrite(str(picture), noisy(light, 0))
    calibration.save(tmp_path / "out")
    command = [
        "pose",
        str(tmp_path / "out"),
        str(picture),
        "--tags",
        "DICT_4X4_50",
        "--size-mm",
        "50",
    ]
    assert main([*command, "--json"]) == 0
    (tag,) = json.loads(capsys.readouterr().out)["pictures"][0]["tags"]
    assert tag["ambiguous"]
    assert len(tag["poses"]) == 2
    assert sum(pose["probability"] for pose in tag["poses"]) == pytest.approx(1)
    assert main(command) == 0
    out = capsys.readouterr().out
    assert out.count("3 (") == 2
    assert (
        "Ambiguous: tag 3 may have either of two poses: show it larger, or less from the front."
        in " ".join(out.split())
    )
