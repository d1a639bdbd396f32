"""A board that moves while pictures are read out, as a cause in the diagnosis of a rig."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.effects.rolling_shutter import RollingShutter
from calib.optics.rotation import matrix
from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.explanations import explanations
from calib.rig.fit_rig import fit_rig
from calib.rig.joint_estimate import RigState
from calib.rig.motion_products import READOUT, MotionProducts
from calib.rig.own_effects import WideState
from calib.rig.rig import Rig
from calib.rig.rig_context import rig_context, times_of
from calib.rig.rig_effects import ROLLING_SHUTTER
from calib.rig.rig_result import state_of
from calib.session.shutter import Shutter
from fixtures.rig_motion import with_readout
from fixtures.rigs import SimulatedRig, simulate_rig, with_pictures
from fixtures.synthetic import HEIGHT
from tests.rig.conftest import BOARD, EVEN, WINDOW
from tests.rig.test_board_flex import SHEET, rms
from tests.rig.test_problem import initial_state

Array = NDArray[np.float64]
STEP = 1e-6
TURN, SHIFT = 3e-3, 5e-4
"""rad and m, of a hand-held board during a readout."""
BOTH = {"left": 1.0, "right": 1.0}
GLOBAL = Shutter(rolling=False)


def test_a_motion_during_the_readout_is_that_of_a_single_camera() -> None:
    """The score of each number is the slope of the squares by `RollingShutter` of this camera,
    whose motion is in the camera frame and not in that of the rig.
    """
    rig = simulate_rig(6, WINDOW, placements=4, amplitude=0.0, board=BOARD)
    state = initial_state(rig, {})
    cameras = tuple(
        replace(camera, observations=camera.observations.add_times(None, HEIGHT))
        for camera in state.cameras
    )
    state = replace(state, cameras=cameras, baseline=None)
    products = MotionProducts.of(WideState(state, np.arange(len(state.vector())), ()))
    columns = products.readouts["right"]
    assert columns.stop - columns.start == READOUT
    score = products.products[:, columns, -1].sum(0)
    information = products.products[:, columns, columns].sum(0)
    for index in range(READOUT):
        moved = [squares_of_right(state, index, size) for size in (STEP, -STEP)]
        slope = (moved[0] - moved[1]) / (4 * STEP)
        scale = information[index, index] ** 0.5 * squares_of_right(state, index, 0.0) ** 0.5
        assert abs(slope) > 1e-3 * scale
        assert abs(score[index] - slope) < 1e-4 * scale


def squares_of_right(state: RigState, index: int, size: float) -> float:
    """Return the squares of the right camera's corners, if one number of the motion of the board
    during its readout has this size, rad or m.
    """
    motion = torch.zeros(READOUT, dtype=torch.float64)
    motion[index] = size
    turn = matrix(state.mountings[1][:3])
    in_camera = torch.cat([turn @ motion[:3], turn @ motion[3:]])
    right = state.cameras[1]
    moving = replace(right, model=right.model.with_effect(RollingShutter()))
    problem = replace(state, cameras=(state.cameras[0], moving)).problem()
    poses = torch.cat([state.poses(1), in_camera.expand(len(right.placement), -1)], 1)
    camera = problem.cameras[1]
    residual, _ = camera.landing.residual(state.vector()[camera.columns], poses)
    return float((residual**2).sum())


@pytest.mark.parametrize(
    ("shutter", "right_shutter", "expected"),
    [
        (None, None, [("", 1.0), ("left", 1.0), ("right", 1.0)]),
        (GLOBAL, None, [("right", 1.0)]),
        (GLOBAL, GLOBAL, []),
        (Shutter(True, 0.01), Shutter(True, 0.03), [("", 9.0), ("left", 1.0), ("right", 1.0)]),
        (Shutter(True, 0.01), None, [("", 1.0), ("left", 1.0), ("right", 1.0)]),
    ],
    ids=["unknown", "one global", "both global", "stated", "one stated"],
)
def test_cameras_that_may_have_a_rolling_shutter_are_asked(
    fitted: Rig,
    shutter: Shutter | None,
    right_shutter: Shutter | None,
    expected: list[tuple[str, float]],
) -> None:
    """Both cameras see the same motion, in parts that are their readouts."""
    shutters = {"left": shutter, "right": right_shutter}
    calibrations = {
        name: replace(c, camera=replace(c.camera, shutter=shutters[name]))
        for name, c in fitted.calibrations.items()
    }
    rig = replace(fitted, calibrations=calibrations)
    state = state_of(rig)
    context = rig_context(rig, state, times_of(rig, len(state.placements)))
    candidates = [e for e in explanations(context) if e.effect is ROLLING_SHUTTER]
    assert [candidate.camera for candidate in candidates] == [camera for camera, _ in expected]
    for candidate, (camera, ratio) in zip(candidates, expected, strict=True):
        assert candidate.random
        turns = candidate.random.shapes[0][0]
        assert len(turns) == READOUT * (1 if camera else 2)
        if camera:
            assert turns[0, 0] == pytest.approx(ratio)
        else:
            assert turns[READOUT, READOUT] / turns[0, 0] == pytest.approx(ratio)
            variances = turns[0, 0] * turns[READOUT, READOUT]
            assert turns[0, READOUT] == pytest.approx(variances**0.5), "fully correlated"


def moving_board(folder: Path, seed: int, readouts: dict[str, float]) -> tuple[Rig, SimulatedRig]:
    """Return the fit of a pair that saw a board in motion, and the pair."""
    rng = np.random.default_rng(seed)
    bare = simulate_rig(seed, WINDOW, placements=1, amplitude=0.0, board=SHEET)
    made = with_readout(rng, with_pictures(rng, bare, 18), readouts, TURN, SHIFT)
    return fit_rig(made.write(folder / "rig"), EVEN), made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("readouts", "camera", "words"),
    [(BOTH, "", "a picture of all cameras"), ({"right": 1.0}, "right", "a picture of right")],
    ids=["both", "one"],
)
def test_a_rolling_shutter_is_found_with_its_size(
    tmp_path: Path, readouts: dict[str, float], camera: str, words: str
) -> None:
    rig, made = moving_board(tmp_path, 1, readouts)
    better, diagnosis = diagnose_rig(rig)
    (effect,) = diagnosis.found
    assert (effect.effect, effect.camera, effect.varies) == (
        "rolling_shutter",
        camera,
        "each_view",
    )
    assert f"the board moves while {words} is read out" in effect.sentence
    for name, true in (("turn", TURN), ("shift", SHIFT)):
        number = effect.parameters[f"rolling_shutter.{name}"]
        assert abs(number.value - true) < 4 * number.sigma < true
    assert diagnosis.after.held_out_px < 0.7 * diagnosis.before.held_out_px
    assert not diagnosis.families
    points, pixels = made.points(6, 200)
    pairs = np.arange(200).reshape(-1, 2)
    true_lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=-1)
    still_lengths, _ = rig.distances(pixels, pairs, 0.0)
    length, sigma = better.distances(pixels, pairs, 0.0)
    assert rms(length - true_lengths) < 0.7 * rms(still_lengths - true_lengths)
    assert 0.3 < rms((length - true_lengths) / sigma) < 2
