"""Typed texts are checked by the session's own rules, and read as the person meant them."""

from dataclasses import replace

import pytest

from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import AprilGrid, Charuco, Coding, grid_board
from calib.session.cover import Cover
from calib.session.schema import Number
from calib.session.shapes.registry import SHAPES
from capture.session_file import read_setup
from capture.tui.form import (
    BOARD,
    HELP,
    FormTexts,
    explain_field,
    find_problem,
    read_form,
    write_form,
)
from tests.capture.recordings import FIXTURE

SETUP = read_setup(FIXTURE / "session.yaml")


def test_written_values_are_read_as_the_same() -> None:
    board, camera, cover = SETUP
    assert read_form(write_form(board, cover), camera) == SETUP
    unsure = Cover(
        cover.shape,
        {
            **cover.parameters,
            "inner_radius": Number(0.041, 0.002),
            "axis_offset.z": Number(-0.03, 0.0001),
        },
    )
    assert read_form(write_form(board, unsure), camera)[2] == unsure
    exact = Cover(
        cover.shape,
        {
            **cover.parameters,
            "thickness": Number(0.003, exact=True),
            "axis_offset.z": Number(-0.03, exact=True),
        },
    )
    assert read_form(write_form(board, exact), camera)[2] == exact


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0, 0, 5", None),
        ("1,2,3", None),
        ("0,-30,5", "write 0, -30.5, with a point, or 0, -30, 5, with a blank, for 3 numbers."),
        ("0,5; 0; 1", "write 0.5, 0, 1, with a point."),
        ("0, 5", "write three numbers, x, y and z, such as 0, 0, 0."),
    ],
)
def test_fields_of_three_numbers_are_checked(text: str, expected: str | None) -> None:
    message = find_problem("centre_mm", text, "dome")
    assert message is None if expected is None else expected in str(message)


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("columns", "9", None),
        ("columns", "2", "write a whole number from 3 to 1000"),
        ("columns", "9.5", "write a whole number"),
        ("rows", "nine", 'is the text "nine"'),
        ("rows", "", "is empty"),
        ("square_mm", "0.02", "0.02 m, if metres were meant, is 20"),
        ("square_mm", "20 ± 1", None),
        ("square_mm", "20 ± x", "write a number"),
        ("square_mm", "20,5", "board.square_mm is 20,5: write 20.5, with a point"),
        ("square_mm", "20,5 +- 0,1", "write 20.5 ± 0.1, with a point"),
        ("square_mm", "20, 5", "is the text"),
        ("thickness_mm", "-2,5", "cover.thickness_mm is -2,5: write -2.5, with a point"),
        ("axis_offset_mm", "0,-30", None),
        ("axis_offset_mm", "0;-30", None),
        (
            "axis_offset_mm",
            "0,5",
            "axis_offset_mm is 0,5: write 0.5, with a point, or 0, 5, with a blank, for 2 numbers",
        ),
        ("axis_offset_mm", "0,5; -30", "write 0.5, -30, with a point."),
        ("axis_offset_mm", "0,5 -30,25", "write 0.5, -30.25, with a point."),
        ("axis_offset_mm", "0,5, -30", "write 0.5, -30, with a point."),
        ("axis_offset_mm", "0,-30,5", "write 0, -30.5, with a point."),
        ("axis_offset_mm", "0 ± 0,5, -30", "write 0 ± 0.5, -30, with a point."),
        (
            "axis_offset_mm",
            "0,1,2",
            "axis_offset_mm is 0,1,2: write two numbers, x and z, such as 0, 0.",
        ),
        ("axis_offset_mm", "x,5", "write a number"),
        ("inner_radius_mm", "41.95", None),
        ("inner_radius_mm", "42 ± 2", None),
        ("inner_radius_mm", "42 +- 2", None),
        ("inner_radius_mm", "42 ± 0", None),
        ("inner_radius_mm", "42 ± -1", "a number above 0"),
        ("inner_radius_mm", "nan", "write a number"),
        ("axis_offset_mm", "0, -30", None),
        ("axis_offset_mm", "0 -30", None),
        ("axis_offset_mm", "0 ± 1, -30 ± 2", None),
        ("axis_offset_mm", "[0, -30]", None),
        (
            "axis_offset_mm",
            "-30",
            "axis_offset_mm is -30: write two numbers, x and z, such as 0, 0.",
        ),
        ("axis_offset_mm", "", "axis_offset_mm is empty: write two numbers"),
        ("tilt_deg", "", None),
        ("refractive_index", "0.5", "from 1 to 3"),
    ],
)
def test_a_value_by_itself(key: str, text: str, expected: str | None) -> None:
    message = find_problem(key, text, "cone")
    assert message is None if expected is None else message is not None and expected in message


def test_values_that_do_not_go_together() -> None:
    typed = write_form(SETUP[0], SETUP[2])
    with pytest.raises(InputError, match="puts the camera outside the cone"):
        read_form(replace(typed, cover={**typed.cover, "axis_offset_mm": "0, -300"}))


@pytest.mark.parametrize(
    "coding",
    [
        Charuco(0.015, "DICT_4X4_250", first_marker=17, inverted=True),
        AprilGrid(0.3, first_marker=5, border=1, numbered_from="upper_left"),
        grid_board(0.3, "DICT_4X4_250", first_marker=9),
    ],
    ids=lambda coding: type(coding).__name__,
)
def test_keys_without_a_field_are_kept(coding: Coding) -> None:
    board = Board(8, 6, 0.02, coding=coding)
    texts = write_form(board, Cover("none", {}))
    assert read_form(texts)[0] == board
    assert not {"first_marker", "inverted"} & texts.board.keys()


def test_every_number_is_explained() -> None:
    assert {key for keys in BOARD.values() for key in keys} <= set(HELP)
    assert all(entry.explanation and entry.words for shape in SHAPES for entry in shape.keys)


def test_the_order_of_the_tilts_is_said() -> None:
    orders = {shape.name: shape.tilt_axes for shape in SHAPES if shape.tilt_axes}
    tilted = {s.name for s in SHAPES if any(e.quantity.key == "tilt_deg" for e in s.keys)}
    assert set(orders) == tilted
    for shape, axes in orders.items():
        first, second = list(axes)
        text = explain_field("tilt_deg", "checkerboard", shape)
        assert text.index(f"about {first}") < text.index(f"about {second}")


def test_no_cover_has_no_numbers() -> None:
    assert read_form(FormTexts({"columns": "9", "rows": "6", "square_mm": "25"}, "none", {}))[
        2
    ] == Cover("none", {})


def test_unknown_is_an_answer_for_numbers_of_the_cover() -> None:
    texts = FormTexts(
        {"columns": "9", "rows": "6", "square_mm": "25"},
        "dome",
        {
            "inner_radius_mm": "?",
            "centre_mm": "0, 0, unknown",
            "thickness_mm": "3, ?",
            "refractive_index": "1.5, 1.49",
            "outside_index": "",
        },
    )
    cover = read_form(texts)[2]
    unknown = [name for name, number in cover.parameters.items() if number.unknown]
    assert unknown == ["inner_radius", "centre.z", "layer2.thickness"]
    assert read_form(write_form(SETUP[0], cover))[2] == cover
    assert (
        read_form(replace(texts, cover={**texts.cover, "centre_mm": "unknown"}))[2]
        .parameters["centre.x"]
        .unknown
    )
    assert find_problem("square_mm", "?", "dome") is not None
    assert find_problem("inner_radius_mm", "", "dome") is not None


def test_shape_may_be_unknown() -> None:
    glass = {"thickness_mm": "3", "refractive_index": "?", "outside_index": ""}
    texts = FormTexts({"columns": "9", "rows": "6", "square_mm": "25"}, "unknown", glass)
    cover = read_form(texts)[2]
    assert cover.has_unknown_shape
    assert write_form(SETUP[0], cover).shape == "unknown"
