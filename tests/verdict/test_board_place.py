"""Checks of sizes: the board stands where it can be, and lengths are in the right unit."""

from dataclasses import replace

import pytest

from calib.calibration import Calibration
from calib.session.board import Board
from calib.session.coding import AprilGrid
from calib.session.parameter_names import COVER
from calib.session.point_target import PointTarget
from calib.session.schema import Number
from calib.verdict.board_place import board_place, board_size, cover_size, small_board
from calib.verdict.verdict import Reason, Trust
from fixtures.known import lens_alone
from fixtures.synthetic import scene
from tests.verdict.cases import asked


@pytest.mark.parametrize(
    ("board", "says"),
    [
        (Board(9, 9, 0.02, 0.01), "board.square_mm is known to 50 % only (20 ± 10 mm), and so is"),
        (Board(9, 9, 0.02, 0.0005), "is known to 2.5 % only"),
        (Board(9, 9, 0.02, 0.00019), ""),
        (Board(9, 9, 0.02, 0.0), ""),
        (Board(9, 9, 25.0), "200 m wide, with squares of 25 m: check board.square_mm, whose unit"),
        (Board(8, 6, 5e-5), "0.00035 m wide"),
        (Board(12, 12, 40.0, coding=AprilGrid(0.3)), "check board.tag_mm, whose unit is the mill"),
        (Board(9, 9, 0.5), ""),
    ],
)
def test_the_board_s_size(good: Calibration, board: Board, says: str) -> None:
    reasons = asked(board_size, replace(good, board=board))
    assert len(reasons) == bool(says)
    assert all(says in reason.sentence and reason.word is Trust.CARE for reason in reasons)


def test_a_board_in_centimetres_or_in_metres(good: Calibration) -> None:
    def scaled(by: float) -> Calibration:
        return replace(
            good, poses=good.poses * ([1.0] * 3 + [by] * 3), board=Board(9, 9, 0.02 * by)
        )

    for by in (0.015, 1000.0):
        (reason,) = asked(board_place, scaled(by))
        assert (reason.word, reason.suspects) == (Trust.DO_NOT_USE, ("board.square_mm",))
    for by in (0.2, 20.0):
        assert not asked(board_place, scaled(by))
    (reason,) = asked(board_size, scaled(0.2))
    assert "would be 32 mm wide, less than the cover's radius of 42 mm" in reason.sentence
    assert not asked(board_size, scaled(0.5))
    small = scaled(0.2)
    radius = {COVER.of("inner_radius"): Number(0.04, 0.02, unknown=True)}
    cover = small.declared.cover.replace_numbers(radius)
    unknown = replace(small, stated=replace(small.declared, cover=cover))
    (reason,) = asked(board_size, unknown)
    assert reason.sentence.startswith("the board would be 32 mm wide: check board.square_mm")
    bare = lens_alone(scene(1, views=1), 640, 480, 640.0, 640.0, 320.0, 240.0)
    small = replace(bare, board=Board(9, 9, 0.002))
    assert not asked(board_size, small)
    (note,) = asked(small_board, small)
    assert note.startswith("the board would be 16 mm wide, and every length that you measure")
    assert not asked(small_board, replace(bare, board=Board(9, 9, 0.02)))


@pytest.mark.parametrize(
    ("by", "says"),
    [(1.0, ""), (1000.0, "would be 300 m wide: check the target's coordinates"), (1e-3, "0.0003")],
)
@pytest.mark.parametrize("origin", [0.0, 5.0])
def test_a_target_of_points_in_millimetres(by: float, says: str, origin: float) -> None:
    """The width is that of the points, wherever their origin is."""
    bare = lens_alone(scene(1, views=1), 640, 480, 640.0, 640.0, 320.0, 240.0)
    places = Board(16, 11, 0.02).points() + origin
    reasons = asked(board_size, replace(bare, board=PointTarget.of(by * places)))
    assert len(reasons) == bool(says)
    assert all(says in reason.sentence and reason.word is Trust.CARE for reason in reasons)


def test_a_target_of_points_smaller_than_the_cover(good: Calibration) -> None:
    def reasons(by: float) -> list[Reason]:
        target = PointTarget.of(by * Board(9, 9, 0.02).points())
        return asked(board_size, replace(good, board=target))

    (reason,) = reasons(0.1)
    assert "the target would be 16 mm wide, less than the cover's radius" in reason.sentence
    assert reason.word is Trust.DO_NOT_USE
    assert not reasons(1.0)


def test_a_board_inside_of_the_cover(good: Calibration) -> None:
    """The boards' middles are moved to 5 mm before the lens: most corners still are outside."""
    poses = good.poses.copy()
    poses[:, 3:] *= 0.005 / poses[:, 5:]
    (reason,) = asked(board_place, replace(good, poses=poses))
    assert "of the corners would be inside the cover" in reason.sentence
    assert reason.word is Trust.DO_NOT_USE


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("inner_radius", 0.0042, "declared as 4.2 mm, and hardly any cover is so small"),
        ("inner_radius", 0.0105, ""),
        ("thickness", 0.0004, "declared as 0.4 mm, and hardly any cover is so thin"),
        ("thickness", 0.0006, ""),
    ],
)
def test_a_length_in_centimetres_is_a_reason(
    good: Calibration, name: str, value: float, says: str
) -> None:
    assert not asked(cover_size, good)
    cover = good.declared.cover.replace_numbers({COVER.of(name): Number(value)})
    reasons = asked(cover_size, replace(good, stated=replace(good.declared, cover=cover)))
    assert len(reasons) == bool(says)
    assert all(says in reason.sentence for reason in reasons)
