"""AquaCal's own generator of cameras over water: its corners are ours, and a rig that is calibrated
from them measures lengths as exactly as AquaCal publishes.
"""

from dataclasses import replace
from types import ModuleType

import cv2
import numpy as np
import pytest

from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from tests.suites.fetch import AQUACAL

PUBLISHED_MM = 0.46
"""The RMS error of lengths of 60 mm, from corners with 0.5 px of noise, that AquaCal publishes."""


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    pytest.importorskip("aquacal", reason=AQUACAL.skipped)
    from fixtures import aquacal_rigs  # it ends the process without AquaCal

    return aquacal_rigs


def test_their_corners_are_ours(generator: ModuleType) -> None:
    """The second camera stands beside the first, at another height over the water."""
    task = generator.make_task(seed=1, cameras=2, frames=8, turn=0.0, level=True)
    truth = task.truth
    detections = generator.detect(truth, truth.board_poses, 0.0, seed=0)
    board = np.array([task.board.corner_positions[i] for i in range(task.board.num_corners)])
    compared = 0
    for name, lens in truth.intrinsics.items():
        mounting = truth.extrinsics[name]
        water = {
            "distance": truth.water_zs[name] - mounting.C[2],
            "tilt.x": 0.0,
            "tilt.y": 0.0,
            "thickness": generator.SHEET,
            "refractive_index": truth.n_water / truth.n_air,
            "outside_index": truth.n_water / truth.n_air,
        }
        numbers = {key: Number(float(value)) for key, value in water.items()}
        (fx, fy), (cx, cy) = lens.K[[0, 1], [0, 1]], lens.K[:2, 2]
        bare = lens_alone(scene(1, views=1), *lens.image_size, fx, fy, cx, cy, *lens.dist_coeffs)
        camera = replace(bare, cover=Cover("flat", numbers))
        for pose in truth.board_poses:
            frame = detections.frames.get(pose.frame_idx)
            if frame is None or name not in frame.detections:
                continue
            corners = frame.detections[name]
            rotation, _ = cv2.Rodrigues(pose.rvec)
            world = board[corners.corner_ids] @ rotation.T + pose.tvec
            ours = camera.project(world @ mounting.R.T + mounting.t)
            assert np.abs(ours - corners.corners_2d).max() < 0.005
            compared += len(ours)
    assert compared > 500


@pytest.mark.slow
def test_a_rig_over_water_measures_lengths(generator: ModuleType) -> None:
    task = generator.make_task(seed=0, cameras=12, frames=30, turn=0.0, level=False)
    declared = generator.measure(task, generator.solve_nothing(task), 0)
    errors = generator.measure(task, generator.solve_by_refracal(task, 1.0), 0)
    assert rms(errors.focal) < rms(declared.focal) / 2
    assert rms(errors.height) < 0.005
    assert 1e3 * rms(errors.exact) < 0.1
    assert 1e3 * rms(errors.noisy) < PUBLISHED_MM


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
