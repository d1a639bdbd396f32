"""mrcal's corners file."""

from pathlib import Path

import numpy as np
import pytest

from calib.corners.corners_file import read_corners, write_corners
from calib.corners.view import View
from calib.errors import InputError
from calib.session.board import Board

BOARD = Board(4, 3, 0.02)


def random_view(name: str, seed: int) -> View:
    """Awkward numbers; one corner in four not seen."""
    rng = np.random.default_rng(seed)
    weight = 0.5 ** rng.integers(0, 4, BOARD.count).astype(float)
    weight[rng.permutation(BOARD.count)[: BOARD.count // 4]] = 0
    return View(name, np.where(weight[:, None] > 0, rng.normal(size=(BOARD.count, 2)) * 1000, np.nan), weight)


def test_written_views_read_as_the_same_numbers(tmp_path: Path) -> None:
    written = [random_view("b.png", 1), random_view("frames/a.png", 2)]
    write_corners(tmp_path / "c.vnl", written)
    read = read_corners(tmp_path / "c.vnl", BOARD)
    assert [view.name for view in read] == ["b.png", "frames/a.png"]
    for got, expected in zip(read, written, strict=True):
        np.testing.assert_array_equal(got.corners, expected.corners)
        np.testing.assert_array_equal(got.weight, expected.weight)
        assert got.count == 9
        np.testing.assert_array_equal(got.seen, ~np.isnan(got.corners).any(-1))


def test_mrcal_s_own_notation(tmp_path: Path) -> None:
    """Comments, another order of columns, an extra one, levels, and each way to say that a corner was not seen."""
    rows = ["1 1.5 a 10 20", "1 0 a 11 21", "1 -1 a 12 22", "1 - a 13 23", "- 0 a - -", *(f"- 2 a {i} 0" for i in range(7)), "- - b - -"]
    text = "\n".join(["#!/usr/bin/mrgingham", "## made by hand", "# y_sigma level filename x y", "", *rows[:6], "# between", *rows[6:]])
    (tmp_path / "c.vnl").write_text(text + "\n")
    (view,) = read_corners(tmp_path / "c.vnl", BOARD)
    assert view.name == "a"
    np.testing.assert_allclose(view.weight, [0.5**1.5, 1, 0, 0, 0, *[0.25] * 7])
    np.testing.assert_array_equal(view.corners[:2], [[10, 20], [11, 21]])
    assert np.isnan(view.corners[2:5]).all()


def test_level_may_be_absent(tmp_path: Path) -> None:
    (tmp_path / "c.vnl").write_text("# filename x y\n" + "a 1 2\n" * BOARD.count)
    assert read_corners(tmp_path / "c.vnl", BOARD)[0].weight.tolist() == [1.0] * BOARD.count


@pytest.mark.parametrize("name", ["a b.png", "#a.png", ""])
def test_name_that_would_not_read_back_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rename it"):
        write_corners(tmp_path / "c.vnl", [random_view(name, 1)])
    assert not (tmp_path / "c.vnl").exists()


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"c\.vnl cannot be read"):
        read_corners(tmp_path / "c.vnl", BOARD)
