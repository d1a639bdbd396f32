"""The benchmarks read mrgingham's output, whether or not it is installed."""

from pathlib import Path

import numpy as np
import pytest

from calib.session.board import Board
from fixtures.corner_pictures import Scene, draw
from fixtures.mrgingham import WAYS, can_find, find, nearest, read

BOARD = Board(3, 3, 1.0)
LEGEND = "# filename x y level\n"


def test_a_board_is_read_as_it_is_printed(tmp_path: Path) -> None:
    """Corners of a coarser level are corners, too; its rows, as it goes through the board, are
    kept.
    """
    places = np.stack(np.meshgrid([10.5, 30.25, 50.0], [5.0, 25.0, 45.125]), -1).reshape(-1, 2)
    rows = [
        f"/a/picture.png {x:.6f} {y:.6f} {level}"
        for (x, y), level in zip(places, (0, 0, 1, 0, 2, 0, 0, 0, 0), strict=True)
    ]
    (tmp_path / "corners.vnl").write_text(LEGEND + "\n".join(rows) + "\n")
    detection = read(tmp_path / "corners.vnl", BOARD)
    assert detection is not None
    np.testing.assert_array_equal(detection, places)
    np.testing.assert_array_equal(nearest(detection[::-1], places + 0.3), places)


def test_no_board_is_none(tmp_path: Path) -> None:
    (tmp_path / "corners.vnl").write_text(LEGEND + "/a/picture.png - - -\n")
    assert read(tmp_path / "corners.vnl", BOARD) is None


def test_mrgingham_is_used_for_square_boards_only() -> None:
    assert not can_find(Board(9, 6, 0.025))


@pytest.mark.skipif(
    not can_find(BOARD),
    reason="mrgingham is not installed (apt-get install mrgingham): its own output was not read",
)
@pytest.mark.parametrize("method", WAYS)
def test_its_corners_are_the_drawn_ones(method: str) -> None:
    scene = Scene(board=Board(7, 7, 1.0), tilt=20.0, noise=0.5)
    made = draw(scene, np.random.default_rng(0))
    detection = find(made.picture, scene.board, method)
    assert detection is not None
    nearest_corners = nearest(detection, made.corners)
    assert len(np.unique(nearest_corners, axis=0)) == scene.board.count
    assert (
        np.hypot(*(nearest_corners - made.corners).T).max() < 1
    )  # a quarter of a pixel was measured
