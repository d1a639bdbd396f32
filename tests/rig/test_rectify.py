"""Rectified pairs, depth pictures and exports, on a small pair behind windows in water."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml
from numpy.typing import NDArray

from calib.cli import main
from calib.errors import InputError
from calib.export.central import best_central
from calib.export.formats import ExportLens
from calib.rig import rectify as module
from calib.rig.depth import depth_picture
from calib.rig.exports import CentralRig, kalibr_files, opencv_files, ros_files
from calib.rig.rectify import RectifiedPair, rectify
from calib.rig.rig import Rig, placed_cameras
from calib.session.camera import Camera, Intrinsics
from calib.session.schema import Number

Array = NDArray[np.float64]
WIDTH, HEIGHT = 410, 308
SCALE = 8
DEPTH = 0.7
PLANE = np.array([0.25, 0.1, 1.0])
"""A wall, PLANE . x = DEPTH, which is not parallel to the pictures."""


@pytest.fixture(scope="module")
def small(fitted: Rig) -> Rig:
    """The same pair with small pictures, and without the views of its fit."""
    calibrations = {}
    for name, calibration in fitted.calibrations.items():
        k = calibration.camera.intrinsics
        assert k
        numbers = (
            k.fx.value / SCALE,
            k.fy.value / SCALE,
            (k.cx.value + 0.5) / SCALE - 0.5,
            (k.cy.value + 0.5) / SCALE - 0.5,
        )
        fx, fy, cx, cy = map(Number, numbers)
        calibrations[name] = replace(
            calibration,
            camera=Camera(WIDTH, HEIGHT, intrinsics=Intrinsics(fx, fy, cx, cy)),
            views=(),
            poses=np.zeros((0, 6)),
            covariance=np.zeros((0, 0)),
            corners_at=np.array([[WIDTH / 2, HEIGHT / 2, DEPTH]]),
        )
    return replace(fitted, calibrations=calibrations, covariance=np.zeros((0, 0)))


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


def test_a_depth_picture_of_a_wall(small: Rig) -> None:
    depths = 0.5, 1.0
    pair = rectify(small, ("left", "right"), 0.67, depths)
    picture = depth_picture(small, pair, wall_pictures(small), depths)
    measured = np.isfinite(picture.depth)
    assert measured.mean() > 0.4
    error = picture.points @ PLANE - DEPTH
    assert abs(np.median(error)) < 0.002
    assert np.median(np.abs(error)) < 0.006
    assert (picture.sigma[measured] > 0).all()
    normalised = error / np.linalg.norm(PLANE) / picture.sigma[measured]
    assert 0.1 < np.median(np.abs(normalised)) < 2


def test_a_picture_of_another_size_is_refused(small: Rig, rectified: RectifiedPair) -> None:
    wrong = np.zeros((10, 10), np.uint8)
    with pytest.raises(InputError, match="10x10 px and the calibration for 410x308"):
        depth_picture(small, rectified, (wrong, wrong), (0.5, 1.0))
    with pytest.raises(InputError, match="two different cameras"):
        rectify(small, ("left", "left"), DEPTH)


def test_exports_say_where_the_cameras_are(small: Rig) -> None:
    """A point that OpenCV projects by the file's numbers is where the rig sees it at the depth."""
    lenses = (ExportLens("opencv", 5), ExportLens("opencv", 8))
    central = CentralRig.of(small, small.names, DEPTH, lenses)
    (text,) = opencv_files(central, "0.7").values()
    file = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    matrices = {key: file.getNode(key).mat() for key in ("M1", "D1", "M2", "D2", "R", "T", "P2")}
    model = best_central(small.calibrations["left"], DEPTH, lenses)
    place = np.array([[0.05, 0.02, DEPTH], [-0.04, 0.06, DEPTH]])
    from_first = place - np.array(model.centre)
    first = cv2.projectPoints(from_first, np.zeros(3), np.zeros(3), matrices["M1"], matrices["D1"])
    turn = cv2.Rodrigues(matrices["R"])[0]
    second = cv2.projectPoints(from_first, turn, matrices["T"], matrices["M2"], matrices["D2"])
    visible = small.project(place)
    assert np.abs(first[0].reshape(-1, 2) - visible["left"]).max() < 0.1
    assert np.abs(second[0].reshape(-1, 2) - visible["right"]).max() < 0.1
    assert "Misfit over the image" in text
    texts = ros_files(central, "0.7")
    assert list(texts) == ["left_0.7m.yaml", "right_0.7m.yaml"]
    info = yaml.safe_load(texts["right_0.7m.yaml"])
    projection = np.array(info["projection_matrix"]["data"]).reshape(3, 4)
    assert projection == pytest.approx(matrices["P2"])
    assert projection[0, 3] / projection[0, 0] == pytest.approx(
        -np.linalg.norm(matrices["T"]), rel=1e-9
    )
    radtan = (ExportLens("radtan", 4),)
    chain = yaml.safe_load(
        kalibr_files(CentralRig.of(small, small.names, DEPTH, radtan), "0.7")["camchain_0.7m.yaml"]
    )
    assert chain["cam1"]["cam_overlaps"] == [0]
    shift = np.array(chain["cam1"]["T_cn_cnm1"])[:3, 3]
    assert np.linalg.norm(shift) == pytest.approx(small.baselines[0].metres, rel=0.02)


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
