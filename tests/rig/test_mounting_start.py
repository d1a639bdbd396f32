"""The start of a rig: mountings, boards that look turned, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from calib.errors import NotEnoughDataError
from calib.optics import rotation
from calib.rig.mounting_start import nearest_turns, start_rig, turn_view
from calib.rig.placements import Placements
from calib.rig.poses import compose, move_points, rotation_vector
from calib.session.board import Board
from calib.session.coding import Charuco
from fixtures.rigs import SimulatedRig, simulate_rig, true_poses
from tests.rig.conftest import BOARD, WINDOW

SQUARE = Board(5, 5, 0.03)
MARKED = Board(6, 5, 0.03, coding=Charuco(0.02, "DICT_4X4_50"))


def quarter(count: int) -> Tensor:
    return torch.tensor([0.0, 0.0, count * torch.pi / 2, 0.0, 0.0, 0.0], dtype=torch.float64)


def turned(poses: Tensor, quarters: list[int]) -> Tensor:
    return compose(poses, torch.stack([quarter(-count) for count in quarters]))


def placements_of(rig: SimulatedRig) -> Placements:
    count = len(rig.placements)
    names = tuple(map(str, range(count)))
    return Placements(names, {name: np.arange(count) for name in rig.cameras})


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    names = ("left", "right", "third")
    return simulate_rig(21, WINDOW, placements=8, amplitude=0.0, board=BOARD, names=names)


@pytest.mark.parametrize(("board", "steps"), [(BOARD, (0, 2)), (SQUARE, (0, 1, 2, 3))])
def test_turned_boards_are_found_by_the_mounting(
    rig: SimulatedRig, board: Board, steps: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(1)
    poses, turns = {}, {}
    for name in rig.cameras:
        turns[name] = rng.choice(steps, len(rig.placements)).tolist()
        noise = torch.from_numpy(rng.normal(0, 1e-3, (len(rig.placements), 6)))
        poses[name] = turned(true_poses(rig, name), turns[name]) + noise
    start = start_rig(poses, placements_of(rig), "left", board)
    for name, camera in rig.cameras.items():
        assert float((start.mountings[name] - camera.mounting).abs().max()) < 5e-3
        assert not start.inconsistent[name].any()
        against = (np.array(turns[name]) - np.array(turns["left"])) % 4
        assert (start.turns[name] % 4 == against).all()


def test_a_camera_that_moved_is_named(rig: SimulatedRig) -> None:
    poses = {name: true_poses(rig, name) for name in ("left", "right")}
    rng = np.random.default_rng(2)
    moved = torch.from_numpy(rng.normal(0, 0.3, (len(rig.placements), 6)))
    poses["right"] = compose(moved, poses["right"])
    places = placements_of(rig)
    with pytest.raises(NotEnoughDataError, match="agree on where it is: correct together"):
        start_rig(poses, places, "left", BOARD)


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ([*range(1, 8), 0], "Paired with the next picture of the other cameras, 7 of 7 pictures"),
        ([7, *range(7)], "Paired with the previous picture of the other cameras, 7 of 7 pictures"),
    ],
    ids=["early", "late"],
)
def test_a_pairing_that_is_one_off_is_named(rig: SimulatedRig, order: list[int], says: str) -> None:
    poses = {"left": true_poses(rig, "left"), "right": true_poses(rig, "right")[order]}
    with pytest.raises(NotEnoughDataError, match=says):
        start_rig(poses, placements_of(rig), "left", BOARD)


def test_a_mirrored_camera_is_named(rig: SimulatedRig) -> None:
    """The mirror maps x to -x in the camera's frame and in the board's."""
    mirror = torch.diag(torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    poses = true_poses(rig, "right")
    turns = mirror @ rotation.matrix(poses[:, :3]) @ mirror
    mirrored = torch.cat([rotation_vector(turns), poses[:, 3:] @ mirror], -1)
    with pytest.raises(NotEnoughDataError, match="With those of right mirrored, 8 of 8 pictures"):
        start_rig(
            {"left": true_poses(rig, "left"), "right": mirrored}, placements_of(rig), "left", BOARD
        )


def test_one_picture_of_another_moment_is_left_out(rig: SimulatedRig) -> None:
    poses = {name: true_poses(rig, name) for name in ("left", "right")}
    poses["right"] = poses["right"].clone()
    poses["right"][3, 3] += 0.1
    start = start_rig(poses, placements_of(rig), "left", BOARD)
    assert np.flatnonzero(start.inconsistent["right"]).tolist() == [3]


def test_boards_that_are_all_alike_do_not_tell_a_turn(rig: SimulatedRig) -> None:
    still_placements = rig.placements[:1].repeat(4, 1)
    mounting = rig.cameras["right"].mounting
    poses = {
        "left": still_placements,
        "right": turned(compose(mounting, still_placements), [0, 2, 0, 2]),
    }
    places = Placements(tuple("abcd"), {name: np.arange(4) for name in poses})
    with pytest.raises(NotEnoughDataError, match="looks the same after a turn"):
        start_rig(poses, places, "left", BOARD)
    poses["right"] = compose(mounting, still_placements)
    start = start_rig(poses, places, "left", MARKED)
    assert not start.turns["right"].any(), "markers tell how the board stands"


def test_a_camera_without_a_shared_picture_is_refused(rig: SimulatedRig) -> None:
    poses = {name: true_poses(rig, name)[:2] for name in ("left", "right")}
    places = Placements(tuple("abcd"), {"left": np.array([0, 1]), "right": np.array([2, 3])})
    with pytest.raises(NotEnoughDataError, match="No picture of right shows the board"):
        start_rig(poses, places, "left", BOARD)


def test_a_chain_of_cameras_needs_no_picture_of_all(rig: SimulatedRig) -> None:
    poses = {
        "left": true_poses(rig, "left")[:4],
        "right": true_poses(rig, "right")[2:6],
        "third": true_poses(rig, "third")[4:],
    }
    indices = {"left": np.arange(4), "right": np.arange(2, 6), "third": np.arange(4, 8)}
    start = start_rig(poses, Placements(tuple("abcdefgh"), indices), "left", BOARD)
    assert float((start.mountings["third"] - rig.cameras["third"].mounting).abs().max()) < 1e-9
    assert float((start.placements - rig.placements).abs().max()) < 1e-9


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_renumbered_view_has_the_pose_without_the_turn(rig: SimulatedRig, quarters: int) -> None:
    """The pixel of a corner of the turned board is that of the same place of the other."""
    placement = rig.placements[:1]
    camera = rig.cameras["left"]
    view = rig.views["left"][0]
    board = SQUARE if quarters % 2 else BOARD
    corners = np.column_stack([board.points(), np.zeros(board.count)])
    turn = compose(placement, quarter(-quarters)[None])[0]

    def pixels(pose: Tensor) -> np.ndarray:
        return camera.see(move_points(pose, torch.from_numpy(corners)).numpy())

    as_turned = replace(view, corners=pixels(turn), weight=np.arange(1.0, board.count + 1))
    back = turn_view(as_turned, board, quarters)
    assert np.abs(back.corners - pixels(placement[0])).max() < 1e-6
    assert sorted(back.weight.tolist()) == as_turned.weight.tolist()


def test_nearest_turns_of_held_out_boards(rig: SimulatedRig) -> None:
    true = true_poses(rig, "right")
    quarters = [0, 2, 2, 0, 0, 2, 0, 2]
    chosen, poses = nearest_turns(turned(true, quarters), true, BOARD)
    assert chosen.tolist() == quarters
    assert float((poses[:, 3:] - true[:, 3:]).abs().max()) < 1e-12
    unknown = torch.full_like(true, torch.nan)
    assert nearest_turns(true, unknown, BOARD)[0].tolist() == [0] * 8
