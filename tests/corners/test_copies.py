"""Copies of a picture, and pictures of a board that stands still."""

from dataclasses import replace

import numpy as np
import pytest

from calib.corners.copies import count_fitted, describe_still, join_still_poses, split_copies
from calib.corners.view import View, pose_labels

RANDOM = np.random.default_rng(5)
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2) * 40 + 100


def view(name: str, shift: float = 0, noise: float = 0.1, pose_id: str | None = None) -> View:
    corners = GRID + shift + RANDOM.normal(0, noise, GRID.shape)
    return View(name, corners, np.ones(len(GRID)), pose_id=pose_id)


def test_a_picture_that_is_there_again_counts_once() -> None:
    views = [view("a"), view("b", 30)]
    copies = [replace(views[0], name="a2"), replace(views[1], name="b2")]
    kept, rejected = split_copies([views[0], copies[0], views[1], copies[1]])
    assert [v.name for v in kept] == ["a", "b"]
    assert [(r.name, r.reason) for r in rejected] == [
        ("a2", "a copy of a, which counts once"),
        ("b2", "a copy of b, which counts once"),
    ]


@pytest.mark.parametrize(
    ("names", "original"),
    [
        (["IMG_1 (1).jpg", "IMG_1.jpg"], "IMG_1.jpg"),
        (["IMG_1.jpg", "IMG_1 - Copy.jpg", "IMG_1_resaved.png"], "IMG_1.jpg"),
        (["a.png", "b.png"], "a.png"),
    ],
)
def test_the_copy_is_the_one_whose_name_is_longer(names: list[str], original: str) -> None:
    """IMG_1 (1).jpg comes first in order, and IMG_1.jpg was left out as its copy."""
    first = view(names[0])
    (picture,), rejected = split_copies([replace(first, name=name) for name in names])
    assert picture.name == original
    assert [r.name for r in rejected] == [name for name in names if name != original]
    assert all(r.reason == f"a copy of {original}, which counts once" for r in rejected)


def test_other_parts_of_a_board_are_not_one_picture() -> None:
    """Two cameras of a rig may see the board's halves, of which no corner is common."""
    whole = view("a")
    halves = np.arange(len(GRID)) < len(GRID) // 2

    def part(shown: np.ndarray) -> View:
        return replace(whole, corners=np.where(shown[:, None], whole.corners, np.nan))

    assert count_fitted([whole], [view("b"), whole]) == 1
    assert count_fitted([part(np.arange(len(GRID)) > 4)], [whole]) == 1
    assert count_fitted([view("b")], [whole]) == 0
    assert count_fitted([part(halves)], [part(~halves)]) == 0
    assert count_fitted([whole], []) == 0
    assert count_fitted([View("c", GRID[:9], np.ones(9))], [whole]) == 0


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.2])
def test_a_board_that_stands_still_is_one_pose(noise: float) -> None:
    views = [view(f"{pose}{k}", 3.0 * pose, noise) for k in range(3) for pose in range(4)]
    joined = join_still_poses(views)
    assert [v.name for v in joined] == [v.name for v in views]
    assert pose_labels(joined).tolist() == [0, 1, 2, 3] * 3
    (sentence,) = describe_still(joined)
    assert "In 8 pictures the board stands still" in sentence
    assert "(01, 11, 21, ...): they count as one view" in sentence


@pytest.mark.parametrize("shift", [1.0, 2.0, 50.0])
def test_a_board_that_moves_has_a_pose_each(shift: float) -> None:
    views = [view(str(k), shift * k, 0.1) for k in range(4)]
    joined = join_still_poses(views)
    assert [v.pose_id for v in joined] == [None] * 4
    assert describe_still(joined) == ()


def test_other_parts_of_a_still_board_are_one_pose_if_half_is_common() -> None:
    whole = view("a")
    for hidden, same in ((10, True), (40, False)):
        weight = np.where(np.arange(len(GRID)) < hidden, 0.0, 1.0)
        part = replace(whole, name="b", weight=weight)
        assert (len(set(pose_labels(join_still_poses([whole, part])))) == 1) == same


def test_a_recorded_pose_keeps_its_id() -> None:
    views = [view("a", pose_id="4"), view("b", pose_id="5"), view("c", 20, pose_id="6")]
    assert [v.pose_id for v in join_still_poses(views)] == ["4", "4", "6"]
    assert join_still_poses([]) == ()
