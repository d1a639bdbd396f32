"""Rectified pairs and depth pictures, on a small pair behind windows in water."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.cli import main
from calib.commands.rig_lines import depth_json, print_depth
from calib.errors import InputError
from calib.rig import feature_matches as feature_module
from calib.rig import rectify as module
from calib.rig.depth import DepthPicture, depth_picture
from calib.rig.feature_matches import FeatureMatches, PairAgreement, match_features
from calib.rig.rectify import RectifiedPair, rectify
from calib.rig.rig import Rig
from calib.rig.rig_geometry import placed_cameras
from tests.rig.conftest import DEPTH, HEIGHT, WIDTH

Array = NDArray[np.float64]
PLANE = np.array([0.25, 0.1, 1.0])
"""A wall, PLANE . x = DEPTH, which is not parallel to the pictures."""


@pytest.fixture(scope="module")
def rectified(small: Rig) -> RectifiedPair:
    return rectify(small, ("left", "right"), DEPTH)


def wall_pictures(rig: Rig) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return what both cameras see of a wall with a random texture."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (1200, 1600)).astype(np.float32), (0, 0), 2.0)
    texture = (texture - texture.min()) / (texture.max() - texture.min()) * 255
    pictures = []
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
    for camera in placed_cameras(rig):
        pixels = torch.from_numpy(np.stack([x.ravel(), y.ravel()], -1))
        rays = camera.rays(pixels)
        origins = rays[0].numpy()
        directions = rays[1].numpy()
        distance = (DEPTH - origins @ PLANE) / (directions @ PLANE)
        places = origins + distance[:, None] * directions
        u = ((places[:, 0] + 0.8) * 1000).reshape(HEIGHT, WIDTH).astype(np.float32)
        v = ((places[:, 1] + 0.6) * 1000).reshape(HEIGHT, WIDTH).astype(np.float32)
        pictures.append(cv2.remap(texture, u, v, cv2.INTER_LINEAR).astype(np.uint8))
    return pictures[0], pictures[1]


def test_rows_are_aligned_where_it_says(small: Rig, rectified: RectifiedPair) -> None:
    """Oracle: a point's pixels, looked up in the maps, are in the same row of both pictures."""
    exact = next(row for row in rectified.rows if row.depth == DEPTH)
    assert exact.worst_px < 1e-9
    assert max(row.worst_px for row in rectified.rows) < 0.2
    points = np.array([[0.02, 0.03, DEPTH], [-0.05, -0.06, DEPTH], [0.1, 0.0, DEPTH]])
    in_pair = points @ rectified.rotation + rectified.centres[0]
    columns = {}
    for name, (map_x, map_y), centre in zip(
        rectified.names, rectified.maps, rectified.centres, strict=True
    ):
        offset = (in_pair - centre) @ rectified.rotation.T
        x = rectified.focal * offset[:, 0] / offset[:, 2] + rectified.principal[0]
        y = rectified.focal * offset[:, 1] / offset[:, 2] + rectified.principal[1]
        sampled = np.column_stack(
            [
                cv2.remap(values, x[None].astype(np.float32), y[None].astype(np.float32), 1)[0]
                for values in (map_x, map_y)
            ]
        )
        visible = small.project(in_pair)[name]
        assert np.abs(sampled - visible).max() < 0.02
        columns[name] = x, y
    assert np.abs(columns["left"][1] - columns["right"][1]).max() < 1e-9
    disparity = columns["left"][0] - columns["right"][0]
    assert disparity == pytest.approx(rectified.focal * rectified.baseline / DEPTH, rel=1e-9)
    assert rectified.projections[1][0, 3] == -rectified.focal * rectified.baseline


@pytest.mark.slow
def test_the_chosen_direction_is_better_than_its_neighbours(small: Rig) -> None:
    near = rectify(small, ("left", "right"), DEPTH, (0.35, 1.4))
    errors = np.array([row.rms_px for row in near.rows])
    cameras = placed_cameras(small)
    lens = near.focal, near.principal, near.size
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 2e-3]))[0] @ near.rotation
    length = float(turn[0] @ (near.centres[1] - near.centres[0]))
    places = near.centres[0], near.centres[0] + length * turn[0]
    depths = np.array([row.depth for row in near.rows])
    turned = module._rows(cameras, turn, places, lens, DEPTH, depths)
    assert np.sqrt(np.mean(errors**2)) < np.sqrt(np.nanmean(turned**2))


@pytest.mark.slow
def test_a_depth_picture_of_a_wall(small: Rig) -> None:
    depths = 0.5, 1.0
    pair = rectify(small, ("left", "right"), 0.67, depths)
    first, second = wall_pictures(small)
    picture = depth_picture(small, pair, (first, second), depths)
    assert picture.features.agreement is PairAgreement.AGREES
    assert depth_picture(small, pair, (second, first), depths).is_swapped
    measured = np.isfinite(picture.depth)
    assert measured.mean() > 0.4
    error = picture.points @ PLANE - DEPTH
    assert abs(np.median(error)) < 0.002
    assert np.median(np.abs(error)) < 0.006
    assert (picture.sigma[measured] > 0).all()
    normalised = error / np.linalg.norm(PLANE) / picture.sigma[measured]
    assert 0.1 < np.median(np.abs(normalised)) < 2


def test_features_reveal_pictures_that_do_not_belong_together(small: Rig) -> None:
    """Negative control: the pictures in their order agree with the rig."""
    names = "left", "right"
    first, second = wall_pictures(small)
    black = np.zeros((HEIGHT, WIDTH), np.uint8)
    for pictures, agreement in (
        ((first, second), PairAgreement.AGREES),
        ((second, first), PairAgreement.SWAPPED),
        ((first, np.roll(second, 40, axis=0)), PairAgreement.DISAGREES),
        ((first, black), PairAgreement.UNDECIDED),
    ):
        features = match_features(small, names, pictures)
        assert features.agreement is agreement, features
        if agreement is PairAgreement.AGREES:
            assert features.agreeing > 0.9 * features.matches > 100
            assert features.agreeing_swapped < 0.05 * features.matches


def test_features_of_large_pictures_are_where_the_picture_has_them() -> None:
    """Features are sought in a reduced picture; their places are those of the large one."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (600, 900)).astype(np.float32), (0, 0), 3.0)
    small_picture = (255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
    large = cv2.resize(small_picture, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    first, second = feature_module._matching_features(small_picture, large)
    assert len(first) > 100
    offset = (second + 0.5) / 3 - 0.5 - first
    assert np.abs(np.median(offset, axis=0)).max() < 0.03
    assert np.median(np.abs(offset)) < 0.1


@pytest.mark.parametrize(
    ("features", "sentence"),
    [
        (FeatureMatches(68, 42, 0), None),
        (FeatureMatches(68, 0, 42), "0 agree with the rig, and 42 in the other order"),
        (FeatureMatches(40, 0, 1), "not of the same moment, or a camera has moved"),
        (FeatureMatches(3, 0, 0), "Too few points look alike in both pictures (3)"),
    ],
)
def test_the_command_doubts_pictures_that_do_not_belong_together(
    features: FeatureMatches, sentence: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    depth = np.full((2, 2), 0.7, np.float32)
    picture = DepthPicture(depth, 0.01 * depth, np.zeros((4, 3)), features)
    print_depth(picture)
    printed = " ".join(capsys.readouterr().out.split())
    assert "100 % of the pixels have a depth" in printed
    assert sentence in printed if sentence else "alike" not in printed
    assert depth_json(picture)["swapped"] == (features.agreeing_swapped > 1)


def test_a_picture_of_another_size_is_refused(small: Rig, rectified: RectifiedPair) -> None:
    wrong = np.zeros((10, 10), np.uint8)
    with pytest.raises(InputError, match="10x10 px and the calibration for 410x308"):
        depth_picture(small, rectified, (wrong, wrong), (0.5, 1.0))
    right = np.zeros((308, 410), np.uint8)
    with pytest.raises(InputError, match="Both pictures are the same"):
        depth_picture(small, rectified, (right, right), (0.5, 1.0))
    with pytest.raises(InputError, match="two different cameras"):
        rectify(small, ("left", "left"), DEPTH)


def test_the_commands_write_their_files(
    fitted: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted.save(tmp_path / "rig")
    rig, out = str(tmp_path / "rig"), tmp_path / "out"
    words = ["rig", "export", rig, "--format", "kalibr", "--depth", "0.7", "-o", str(out), "--json"]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert [Path(path).name for path in result["written"]] == ["camchain_0.7m.yaml"]
    assert result["cameras"]["left"]["misfits"][1]["depth_m"] == 0.7
    assert main([*words[:-1], "--pair", "left", "middle"]) == 2
    assert "The rig has no camera 'middle'" in capsys.readouterr().err
