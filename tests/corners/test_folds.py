"""The folds of a cross-validation."""

import numpy as np

from calib.corners.folds import split_folds
from calib.corners.view import View


def test_each_pose_is_held_out_once_with_all_views_of_its_burst() -> None:
    corners = np.zeros((4, 2))
    views = [
        View(f"{index}.png", corners, np.ones(4), pose_id=f"pose {index // 2}")
        for index in range(10)
    ]
    folds = list(split_folds(views, 3))
    indices = [np.flatnonzero(fold.held_out).tolist() for fold in folds]
    assert indices == [[0, 1, 6, 7], [2, 3, 8, 9], [4, 5]]
    for fold in folds:
        assert [view.name for view in fold.test] == [
            views[i].name for i in np.flatnonzero(fold.held_out)
        ]
        assert len(fold.test) + len(fold.training) == len(views)
