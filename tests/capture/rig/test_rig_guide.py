"""The guide of a rig: its information against differences, its start, and whether it leads to an
accurate pair.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.planning.pose_bank import fit_bare_pose, outline_corners
from calib.session.camera import Camera
from capture.rig.moment_gate import Corners
from capture.rig.rig_guide import TARGET_PX, RigGuide
from capture.rig.rig_information import (
    NOISE_PX,
    RigModel,
    compose_poses,
    disparity_sigma,
    invert_pose,
)
from capture.rig.rig_start import estimate_mountings
from tests.capture.rig.pair_recordings import BOARD, CAMERA, MODEL, SHARED, SIZE

STEP = 1e-5
UNKNOWN = {name: Camera(*SIZE) for name in MODEL.cameras}


def moment(placement: NDArray[np.float64]) -> Corners:
    """Return the corners of the cameras that see the whole board."""
    pixels = {name: MODEL.project(name, placement) for name in MODEL.cameras}
    return {name: corners for name, corners in pixels.items() if np.isfinite(corners).all()}


def test_information_agrees_with_central_differences_of_the_right_mounting() -> None:
    """Oracle: the corners of both cameras, differentiated by the right camera's mounting and by the
    placement, which is then eliminated.
    """
    (placement, *_) = SHARED
    visible = {name: np.ones(BOARD.count, bool) for name in MODEL.cameras}
    information = MODEL.information(placement, visible)[-6:, -6:]

    def corners(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        mountings = {"left": np.zeros(6), "right": MODEL.mountings["right"] + numbers[:6]}
        moved = RigModel(BOARD, MODEL.cameras, mountings)
        pixels = [moved.project(name, placement + numbers[6:]) for name in MODEL.cameras]
        return np.concatenate(pixels).ravel()

    slopes = np.stack(
        [(corners(STEP * row) - corners(-STEP * row)) / (2 * STEP) for row in np.eye(12)], -1
    )
    hessian = slopes.T @ slopes / NOISE_PX**2
    cross = hessian[:6, 6:]
    expected = hessian[:6, :6] - cross @ np.linalg.solve(hessian[6:, 6:], cross.T)
    assert np.abs(information - expected).max() < 1e-5 * np.abs(expected).max()


def test_a_view_of_one_camera_tells_nothing_about_the_mounting() -> None:
    visible = {"left": np.ones(BOARD.count, bool)}
    information = MODEL.information(SHARED[0], visible)
    assert not information[-6:].any()
    assert information[0, 0] > 0


def test_the_mounting_is_found_from_boards_that_are_numbered_from_the_other_end() -> None:
    views = [dict(moment(placement)) for placement in SHARED]
    views[1]["right"] = views[1]["right"][::-1]
    views[2]["left"] = views[2]["left"][::-1]
    cameras = dict.fromkeys(MODEL.cameras, CAMERA)
    mountings = estimate_mountings(BOARD, cameras, views)
    assert mountings
    assert np.abs(mountings["right"] - MODEL.mountings["right"]).max() < 1e-3
    assert estimate_mountings(BOARD, cameras, [{"left": views[0]["left"]}]) is None


def test_without_a_shared_view_the_guide_asks_for_one() -> None:
    hint, progress = RigGuide(BOARD, UNKNOWN).advise(())
    assert hint is None
    assert "No view is shared yet" in progress.sentence


def test_near_and_tilted_views_tell_more_than_a_board_that_stays() -> None:
    """Negative control: views in nearly the same place, as many, leave a larger error."""
    derivatives = MODEL.disparity_derivatives(np.array([0.4, 0.6, 1.0]))
    visible = {name: np.ones(BOARD.count, bool) for name in MODEL.cameras}
    prior = np.diag(RigModel(BOARD, UNKNOWN, MODEL.mountings).prior_sigma() ** -2.0)
    spread = sum((MODEL.information(placement, visible) for placement in SHARED), prior)
    still = prior + len(SHARED) * MODEL.information(SHARED[0], visible)
    assert disparity_sigma(derivatives, spread) < 0.3 * disparity_sigma(derivatives, still)


@pytest.mark.slow
def test_guided_views_reach_the_target_where_random_ones_do_not() -> None:
    """Prints how many guided views the simulated pair needs, and what as many random ones leave."""
    guide, rng = RigGuide(BOARD, UNKNOWN), np.random.default_rng(4)
    views = [moment(SHARED[0])]
    sigma = np.inf
    while sigma > TARGET_PX:
        hint, progress = guide.advise(views)
        sigma = progress.sigma_px or np.inf
        assert len(views) < 20
        if hint is None or sigma <= TARGET_PX:
            break
        views.append(moment(_held_at(hint.outlines)))
    randomly: list[Corners] = []
    while len(randomly) < len(views):
        depth = rng.uniform(0.4, 1.0)
        place = [*rng.uniform(-0.5, 0.5, 2), 0.0, *rng.uniform(-0.2, 0.2, 2) * depth, depth]
        view = moment(np.array(place))
        randomly += [view] if len(view) == len(MODEL.cameras) else []
    _, progress = guide.advise(randomly)
    print(f"{len(views)} guided views: {sigma:.2f} px; as many at random: {progress.sigma_px:.2f}")
    assert progress.sigma_px
    assert progress.sigma_px > 2 * sigma


def _held_at(outlines: Corners) -> NDArray[np.float64]:
    """Return the (6,) placement of a board that is held where the outlines ask for it."""
    name = next(iter(outlines))
    corners = np.full((BOARD.count, 2), np.nan)
    corners[outline_corners(BOARD)] = outlines[name]
    pose = fit_bare_pose(BOARD, CAMERA, corners)
    assert pose is not None
    return compose_poses(invert_pose(MODEL.mountings[name]), pose)
