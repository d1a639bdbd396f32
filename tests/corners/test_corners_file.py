"""mrcal's corners file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.corners.corners_file import HIGHEST_LEVEL, read_corners, write_corners
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.session.board import Board

BOARD = Board(4, 3, 0.02)


def random_view(name: str, seed: int) -> View:
    """Awkward numbers; one corner in four not seen."""
    rng = np.random.default_rng(seed)
    weight = 0.5 ** rng.integers(0, 4, BOARD.count).astype(float)
    weight[rng.permutation(BOARD.count)[: BOARD.count // 4]] = 0
    return View(
        name,
        np.where(weight[:, None] > 0, rng.normal(size=(BOARD.count, 2)) * 1000, np.nan),
        weight,
    )


def test_written_views_read_as_the_same_numbers(tmp_path: Path) -> None:
    written = [random_view("b.png", 1), random_view("frames/a.png", 2)]
    write_corners(tmp_path / "c.vnl", [replace(view, blur=view.corners**2) for view in written])
    read = read_corners(tmp_path / "c.vnl", BOARD)
    assert [view.blur for view in read] == [None, None], "the file has no column for it"
    assert [view.name for view in read] == ["b.png", "frames/a.png"]
    for got, expected in zip(read, written, strict=True):
        np.testing.assert_array_equal(got.corners, expected.corners)
        np.testing.assert_array_equal(got.weight, expected.weight)
        assert got.count == 9
        np.testing.assert_array_equal(got.seen, ~np.isnan(got.corners).any(-1))


def test_covariances_are_three_more_columns(tmp_path: Path) -> None:
    plain, measured = random_view("a.png", 1), random_view("b.png", 2)
    half = np.random.default_rng(3).normal(size=(BOARD.count, 2, 2))
    covariance = np.where(
        measured.seen[:, None, None], half @ half.swapaxes(1, 2) + np.eye(2), np.nan
    )
    write_corners(tmp_path / "c.vnl", [plain, replace(measured, covariance=covariance)])
    assert (tmp_path / "c.vnl").read_text().startswith("# filename x y level xx xy yy\n")
    first, second = read_corners(tmp_path / "c.vnl", BOARD)
    assert first.covariance is None
    np.testing.assert_array_equal(second.covariance, covariance)
    np.testing.assert_array_equal(second.corners, measured.corners)


@pytest.mark.parametrize("wrong", ["-1 0 1", "1 2 1", "0 0 0"])
def test_a_matrix_that_is_no_covariance_is_refused(wrong: str, tmp_path: Path) -> None:
    (tmp_path / "c.vnl").write_text("# filename x y xx xy yy\n" + f"a 1 2 {wrong}\n" * BOARD.count)
    with pytest.raises(InputError, match=r"line 2: xx, xy and yy are .* no covariance"):
        read_corners(tmp_path / "c.vnl", BOARD)


def test_mrcal_s_own_notation(tmp_path: Path) -> None:
    """Comments, another order of columns, an extra one, levels, and each way to say that a corner
    was not seen.
    """
    rows = [
        "1 1.5 a 10 20",
        "1 0 a 11 21",
        "1 -1 a 12 22",
        "1 - a 13 23",
        "- 0 a - -",
        *(f"- 2 a {i} 0" for i in range(7)),
        "- - b - -",
    ]
    text = "\n".join(
        [
            "#!/usr/bin/mrgingham",
            "## made by hand",
            "# y_sigma level filename x y",
            "",
            *rows[:6],
            "# between",
            *rows[6:],
        ]
    )
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


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("corners") / "c.vnl"


names = st.text(min_size=1, max_size=12).filter(
    lambda name: name.split() == [name] and not name.startswith("#")
)
pixel = st.floats(allow_nan=False, allow_infinity=False)
levels = st.one_of(st.none(), st.integers(0, HIGHEST_LEVEL))


@given(
    st.dictionaries(
        names,
        st.lists(st.tuples(pixel, pixel, levels), min_size=BOARD.count, max_size=BOARD.count),
        min_size=1,
        max_size=3,
    )
)
def test_any_views_read_as_they_were_written(
    file: Path, made: dict[str, list[tuple[float, float, int | None]]]
) -> None:
    """To the last bit, with weights that are whole levels; a view without a corner is left out, as
    it shows no board.
    """
    views = [
        View(
            name,
            np.array([(x, y) if level is not None else (np.nan, np.nan) for x, y, level in rows]),
            np.array([0.0 if level is None else 0.5**level for _, _, level in rows]),
        )
        for name, rows in made.items()
    ]
    write_corners(file, views)
    shown = [view for view in views if view.count]
    if not shown:
        with pytest.raises(NotEnoughDataError, match="none with a board"):
            read_corners(file, BOARD)
        return
    read = read_corners(file, BOARD)
    assert [view.name for view in read] == [view.name for view in shown]
    for got, expected in zip(read, shown, strict=True):
        np.testing.assert_array_equal(got.corners, expected.corners)
        np.testing.assert_array_equal(got.weight, expected.weight)


@given(st.floats(0.5**HIGHEST_LEVEL, 1))
def test_any_weight_is_saved_to_the_precision_of_its_level(file: Path, weight: float) -> None:
    """A level of up to 100 has its last bit at 1.4e-14: half of it, times log 2, is the
    weight's.
    """
    write_corners(file, [View("a", np.zeros((BOARD.count, 2)), np.full(BOARD.count, weight))])
    assert read_corners(file, BOARD)[0].weight == pytest.approx(weight, rel=5e-15)


def test_a_corner_below_the_highest_level_is_none(tmp_path: Path) -> None:
    weight = np.full(BOARD.count, 1.0)
    weight[0] = 0.5 ** (HIGHEST_LEVEL + 1)
    write_corners(tmp_path / "c.vnl", [View("a", np.zeros((BOARD.count, 2)), weight)])
    assert read_corners(tmp_path / "c.vnl", BOARD)[0].weight.tolist() == [0.0] + [1.0] * (
        BOARD.count - 1
    )


fields = st.one_of(
    st.sampled_from(
        [
            "-",
            "a",
            "b.png",
            "0",
            "1.5",
            "-1",
            "1e999",
            "nan",
            "1_0",
            "#",
            "# filename x y level",
            "# x filename y x",
        ]
    ),
    st.floats().map(repr),
    st.text(max_size=6),
)
lines = st.lists(st.lists(fields, max_size=5).map(" ".join), max_size=15).map("\n".join)
changes = st.lists(st.tuples(st.integers(0, 10), st.integers(0, 3), fields), max_size=3)


@st.composite
def near_misses(draw: st.DrawFn) -> str:
    """A good file with a few of its fields changed, or a line too many or too few."""
    table = [
        ["a", "1.5", "2.5", "0"]
        for _ in range(BOARD.count + draw(st.sampled_from([0, 0, 0, 1, -1])))
    ]
    for row, column, field in draw(changes):
        table[row][column] = field
    return "\n".join(["# filename x y level", *map(" ".join, table)])


def read_or_refused(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", newline="")
    views: tuple[View, ...] = ()
    refused = ""
    try:
        views = read_corners(file, BOARD)
    except (InputError, NotEnoughDataError) as error:
        refused = str(error)
    assert bool(views) != refused.startswith(str(file))
    assert "\n" not in refused
    for view in views:
        assert view.corners.shape == (BOARD.count, 2)
        assert np.isfinite(view.corners[view.seen]).all()
        assert view.count > 0


@given(near_misses())
def test_a_file_with_a_few_wrong_fields_is_read_or_refused_in_a_sentence(
    file: Path, text: str
) -> None:
    read_or_refused(file, text)


@given(st.one_of(lines, lines.map(lambda text: f"# filename x y level\n{text}")))
def test_any_text_is_read_or_refused_in_a_sentence(file: Path, text: str) -> None:
    read_or_refused(file, text)
