"""A rig whose target is a screen: each camera sees points of its own, in the same placements."""

from pathlib import Path

import numpy as np
import pytest

from calib.checking.result import CheckStatus
from calib.rig.check_rig import check_rig
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.mounting_agreement import turn_steps
from calib.rig.rig import Rig
from calib.rig.rig_file import read_rig
from calib.session.board import Board
from calib.session.point_target import PointTarget
from calib.session.session import read_session
from fixtures.point_sessions import POINT_NOISE, SCREEN_WIDTH, corner_of_planes, write_point_rig
from fixtures.rigs import BASELINE, SimulatedRig, simulate_rig, with_motion, with_pictures
from tests.rig.conftest import EVEN, WINDOW

BOOK = PointTarget.of(corner_of_planes(8, 8, 0.02))
SCREEN = Board(24, 15, SCREEN_WIDTH / 24)
TENTH_OF_A_MM = np.array([0.0, 0.0, 0.0, 1e-4, 0.0, 0.0])


@pytest.fixture(scope="module")
def screened() -> SimulatedRig:
    return simulate_rig(5, WINDOW, placements=10, amplitude=0.0, noise_px=POINT_NOISE, board=SCREEN)


@pytest.fixture(scope="module")
def calibrated(screened: SimulatedRig, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return fit_rig(write_point_rig(tmp_path_factory.mktemp("screens"), screened).parent, EVEN)


def later(rig: SimulatedRig, folder: Path) -> Path:
    """Write three later placements, and return the folder."""
    pictures = with_pictures(np.random.default_rng(8), rig, 3)
    return write_point_rig(folder, pictures).parent


@pytest.mark.slow
def test_points_tell_where_the_cameras_are(screened: SimulatedRig, calibrated: Rig) -> None:
    true = screened.cameras["right"].mounting.numpy()
    shift = calibrated.mounting("right").T_camera_reference[:3, 3]
    baseline = float(np.linalg.norm(shift))
    print(f"baseline {1e3 * baseline:.4f} mm, true {1e3 * np.linalg.norm(true[3:]):.4f} mm")
    assert abs(baseline - float(np.linalg.norm(true[3:]))) < 1e-3 * BASELINE


@pytest.mark.slow
def test_later_points_are_evaluated_with_one_pose_for_all_cameras(
    screened: SimulatedRig, calibrated: Rig, tmp_path: Path
) -> None:
    evaluation = evaluate_rig(calibrated, later(screened, tmp_path))
    assert evaluation.shared_placements == 3
    assert evaluation.rms_px < 2 * POINT_NOISE
    assert evaluation.lengths == ()  # no point is seen by two cameras


@pytest.mark.slow
def test_a_rig_is_checked_by_points(
    screened: SimulatedRig, calibrated: Rig, tmp_path: Path
) -> None:
    """The rig is valid as it was, and not after one camera moved by a tenth of a millimetre."""
    valid = check_rig(calibrated, later(screened, tmp_path / "same"))
    assert valid.status is CheckStatus.VALID
    moved = with_motion(screened, "right", TENTH_OF_A_MM)
    changed = check_rig(calibrated, later(moved, tmp_path / "moved"))
    assert changed.status is CheckStatus.DEGRADED
    (change,) = changed.changes
    assert change.camera == "right"
    assert change.change.value == pytest.approx(0.1, rel=0.3)


@pytest.mark.slow
def test_points_in_space_tell_where_the_cameras_are(tmp_path: Path) -> None:
    """The target has two planes at an angle."""
    made = simulate_rig(5, WINDOW, placements=10, amplitude=0.0, noise_px=0.05, board=BOOK)
    rig = fit_rig(write_point_rig(tmp_path / "rig", made).parent, EVEN)
    true = made.cameras["right"].mounting.numpy()[3:]
    shift = rig.mounting("right").T_camera_reference[:3, 3]
    print(f"off by {1e3 * (shift - true)} mm")
    assert np.abs(shift - true)[:2].max() < 1e-3 * BASELINE
    assert check_rig(rig, later(made, tmp_path / "same")).status is CheckStatus.VALID
    moved = with_motion(made, "right", TENTH_OF_A_MM)
    changed = check_rig(rig, later(moved, tmp_path / "moved"))
    assert [change.camera for change in changed.changes] == ["right"]


def test_a_camera_may_see_a_flat_part_of_the_target(tmp_path: Path) -> None:
    """Its points are those of the one target in space that the other camera sees."""
    made = simulate_rig(5, WINDOW, placements=3, amplitude=0.0, noise_px=0.05, board=BOOK)
    description = write_point_rig(tmp_path, made)
    for file in (tmp_path / "right" / "points").iterdir():
        with np.load(file) as content:
            arrays = dict(content)
        np.savez(file, **{**arrays, "target": arrays["target"] * [1, 1, 0]})
    assert read_session(tmp_path / "right").board.is_flat
    sessions = read_rig(description).sessions
    assert [session.board.is_flat for session in sessions.values()] == [False, False]
    np.testing.assert_array_equal(sessions["right"].board.points()[:, 2], 0.0)


def test_points_do_not_look_the_same_after_a_turn() -> None:
    assert turn_steps(SCREEN) == (0, 2)
    assert turn_steps(PointTarget.of(SCREEN.points())) == (0,)
