"""The labels of views: which of them show one pose of the board, and in which order they were
taken.
"""

from dataclasses import replace

import numpy as np

from calib.corners.view import View, are_timed, capture_times, pose_labels


def views(*rows: tuple[float | None, str | None]) -> list[View]:
    return [
        View(f"{index}.png", np.full((4, 2), index), np.ones(4), time_s, pose)
        for index, (time_s, pose) in enumerate(rows)
    ]


def test_views_of_a_burst_share_a_pose_and_others_have_their_own() -> None:
    assert pose_labels(
        views((None, "7"), (None, None), (None, "7"), (None, "2"), (None, None))
    ).tolist() == [0, 1, 0, 2, 3]
    assert pose_labels([]).tolist() == []


def test_a_view_without_a_label_does_not_share_the_label_of_its_index() -> None:
    """A view without a label is not taken for one of the burst that is called after its place."""
    assert pose_labels(views((None, "1"), (None, None), (None, "1"))).tolist() == [0, 1, 0]


def test_copies_of_one_picture_share_a_pose() -> None:
    first, second = views((None, None), (None, None))
    cut = replace(second, weight=np.array([1.0, 1.0, 1.0, 0.0]))
    assert pose_labels([first, second, replace(first, name="copy.png"), cut]).tolist() == [
        0,
        1,
        0,
        2,
    ]


def test_times_are_used_if_every_view_has_one_and_they_differ() -> None:
    timed = views((3.0, None), (1.0, None))
    assert are_timed(timed)
    assert capture_times(timed).tolist() == [3.0, 1.0]
    for unknown in (views((3.0, None), (None, None)), views((3.0, None), (3.0, None))):
        assert not are_timed(unknown)
        assert capture_times(unknown).tolist() == [0.0, 1.0]
