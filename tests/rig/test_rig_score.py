"""The benchmarks' error of a rig, which every program is measured by, against `calib rig evaluate`
and against a pair of pinhole cameras that are known.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.corners.corners_file import write_corners
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.rig import Rig
from fixtures.rig_score import (
    Floats,
    PlacedCamera,
    Score,
    read_corners,
    score,
    shared_corners,
    with_best_mounting,
)
from fixtures.rigs import SimulatedRig

BOARD = np.array([[0.03 * x, 0.03 * y, 0.004 * x * y / 12] for y in range(4) for x in range(5)])
MOUNTING = np.array([0.02, -0.05, 0.01, -0.06, 0.001, 0.002])
NOISE_PX = 0.1
PLACEMENTS = 8


def project(points: Floats) -> Floats:
    return 600 * points[:, :2] / points[:, 2:] + [320, 240]


PAIR = {
    "left": PlacedCamera(project, np.zeros(6), BOARD),
    "right": PlacedCamera(project, MOUNTING, BOARD),
}


@pytest.fixture(scope="module")
def corners() -> dict[str, Floats]:
    """Corners of tilted boards in both cameras, by OpenCV's rotations, with noise."""
    rng = np.random.default_rng(4)
    turn = cv2.Rodrigues(MOUNTING[:3])[0]
    places: dict[str, list[Floats]] = {"left": [], "right": []}
    for _ in range(PLACEMENTS):
        tilt = cv2.Rodrigues(rng.normal(0, 0.4, 3))[0]
        points = BOARD @ tilt.T + [*rng.uniform(-0.15, 0.05, 2), rng.uniform(0.4, 0.7)]
        places["left"].append(project(points))
        places["right"].append(project(points @ turn.T + MOUNTING[3:]))
    return {
        name: np.array(rows) + rng.normal(0, NOISE_PX, (PLACEMENTS, len(BOARD), 2))
        for name, rows in places.items()
    }


def test_the_error_of_the_true_pair_is_the_noise(corners: dict[str, Floats]) -> None:
    measured = score(PAIR, corners)
    numbers = 4 * len(BOARD)
    expected = np.sqrt(2) * NOISE_PX * np.sqrt(1 - 6 / numbers)
    assert measured.rms_px == pytest.approx(expected, rel=0.05)
    assert np.sqrt(np.mean(measured.by_placement**2)) == pytest.approx(measured.rms_px)
    crossed = np.sqrt(2) * NOISE_PX * np.sqrt(1 + 6 / (numbers / 2))
    assert measured.crossed_px == pytest.approx(crossed, rel=0.1)
    assert abs(measured.correlation) < 0.2


def test_a_board_that_bends_errs_in_both_cameras_alike(corners: dict[str, Floats]) -> None:
    flat = {name: replace(camera, board=BOARD * [1, 1, 0]) for name, camera in PAIR.items()}
    measured = score(flat, corners)
    assert measured.rms_px > 2 * score(PAIR, corners).rms_px
    assert measured.correlation > 0.7


def test_scores_pass_through_json_and_join(corners: dict[str, Floats]) -> None:
    pieces = []
    for places in (slice(0, 3), slice(3, None)):
        rows = {name: camera[places] for name, camera in corners.items()}
        pieces.append(Score.of_document(score(PAIR, rows).document()))
    joined = Score.join(pieces)
    total = score(PAIR, corners)
    assert joined.rms_px == pytest.approx(total.rms_px, rel=1e-6)
    assert joined.crossed_px == pytest.approx(total.crossed_px, rel=1e-6)
    assert joined.correlation == pytest.approx(total.correlation, abs=1e-6)
    assert joined.of_camera("right") == pytest.approx(total.of_camera("right"), rel=1e-6)


def test_the_best_mounting_has_the_least_squares(corners: dict[str, Floats]) -> None:
    shift = np.array([0.01, -0.01, 0.005, 0.002, -0.001, 0.003])
    moved = {**PAIR, "right": replace(PAIR["right"], mounting=MOUNTING + shift)}
    best = with_best_mounting(moved, "right", corners)
    np.testing.assert_allclose(best["right"].mounting, MOUNTING, atol=1e-3)
    smallest = score(best, corners).rms_px
    assert smallest < score(PAIR, corners).rms_px
    for step in 1e-3 * np.vstack([np.eye(6), -np.eye(6)]):
        near = replace(best["right"], mounting=best["right"].mounting + step)
        assert score({**best, "right": near}, corners).rms_px > smallest


def test_a_corner_that_was_not_seen_has_no_part_in_the_score(corners: dict[str, Floats]) -> None:
    hidden = {name: rows.copy() for name, rows in corners.items()}
    hidden["right"][0, :7] = np.nan
    measured = score(PAIR, hidden)
    assert measured.corners["right"][0] == len(BOARD) - 7
    assert measured.rms_px == pytest.approx(score(PAIR, corners).rms_px, rel=0.05)


def test_a_corners_file_without_a_corner(tmp_path: Path) -> None:
    file = tmp_path / "corners.vnl"
    file.write_text("# filename x y level\na.png 1.5 2 0\na.png - - -\n")
    np.testing.assert_array_equal(read_corners(file)["a.png"], [[1.5, 2.0], [np.nan, np.nan]])


@pytest.mark.slow
def test_the_score_is_the_error_of_rig_evaluate(
    fitted: Rig, pair: SimulatedRig, pair_folder: Path, tmp_path: Path
) -> None:
    files = {name: tmp_path / f"{name}.vnl" for name in pair.views}
    for name, file in files.items():
        write_corners(file, pair.views[name])
    board = np.column_stack([pair.board.points(), np.zeros(pair.board.count)])
    cameras = {
        name: PlacedCamera(calibration.project, mounting, board)
        for (name, calibration), mounting in zip(
            fitted.calibrations.items(), fitted.mountings, strict=True
        )
    }
    measured = score(cameras, shared_corners(files))
    evaluation = evaluate_rig(fitted, pair_folder)
    assert measured.rms_px == pytest.approx(evaluation.rms_px, rel=1e-3)
    for name, error in evaluation.cameras.items():
        assert measured.of_camera(name) == pytest.approx(error, rel=1e-2)
