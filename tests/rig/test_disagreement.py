"""The joint estimate of cameras that do not see the board at the same place."""

from dataclasses import replace

import numpy as np
import pytest

from calib.rig.disagreement import estimate_with_disagreement, with_noise
from calib.rig.joint_estimate import RigEstimate, RigState, estimate_rig
from calib.session.board import Board
from fixtures.rig_motion import with_bursts
from fixtures.rigs import simulate_rig
from tests.rig.conftest import WINDOW
from tests.rig.test_problem import initial_state

NOISE_PX = 0.02
"""As of rendered pictures: a tenth of a pixel of disagreement is then many times the noise."""
LATE_S = 8e-3


def bursts(late_s: float) -> RigState:
    """Return a start for a pair that sees a moving board; its right camera exposes late."""
    board = Board(9, 9, 0.020)
    rig = simulate_rig(31, WINDOW, placements=1, amplitude=0.0, noise_px=NOISE_PX, board=board)
    moving = with_bursts(np.random.default_rng(31), rig, 3, 4, late_s={"right": late_s})
    state = replace(initial_state(moving, {}), baseline=None)
    return with_noise(state, dict.fromkeys(moving.cameras, NOISE_PX))


def largest_deviation(estimate: RigEstimate) -> float:
    """Return the largest deviation of a declared number over its declared sigma."""
    vector = estimate.vector.numpy()
    sigmas = np.sqrt(np.linalg.pinv(estimate.problem.precision.numpy()).diagonal())
    declared = sigmas > 0
    return float(np.abs(vector[declared] / sigmas[declared]).max())


@pytest.fixture(scope="module")
def late() -> RigState:
    return bursts(LATE_S)


@pytest.mark.slow
def test_a_disagreement_does_not_override_what_is_declared(late: RigState) -> None:
    with_own_noise = estimate_rig(late)
    estimate = estimate_with_disagreement(late)
    print(largest_deviation(with_own_noise), largest_deviation(estimate))
    # Each declared number is off by a draw of its sigma: of twenty, hardly one by more than 3.
    assert largest_deviation(estimate) < 4
    assert largest_deviation(with_own_noise) > 5, "the disagreement is large enough to override"
    (noise,) = {camera.sigma for camera in estimate.state.cameras}
    assert noise > 10 * NOISE_PX


def test_cameras_that_agree_keep_the_noise_of_their_own_fits() -> None:
    start = bursts(0.0)
    estimate = estimate_with_disagreement(start)
    assert {camera.sigma for camera in estimate.state.cameras} == {NOISE_PX}
    assert estimate.cost == estimate_rig(start).cost
