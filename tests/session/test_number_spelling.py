"""A number that a person wrote as people do gets the spelling that session.yaml takes."""

from pathlib import Path

import pytest

from calib.errors import InputError
from calib.io.yaml_reader import read_yaml
from calib.session.session import read_session

BOARD = "board: {columns: 9, rows: 6, square_mm: 25}"
DOME = """\
cover:
  shape: dome
  inner_radius_mm: 50
  centre_mm: [0, 0, -8]
  thickness_mm: 4
  refractive_index: 1.49
"""
TEXT = f"format: 1\n{BOARD}\ncamera: {{width: 960, height: 720}}\n{DOME}"


@pytest.mark.parametrize(
    ("written", "instead", "says"),
    [
        ("square_mm: 25", "square_mm: '25'", "drop the quotes"),
        ("square_mm: 25", "square_mm: ２５", "write 25, in the digits 0 to 9 alone"),
        ("square_mm: 25", "square_mm: 2_5", "write 25, in the digits 0 to 9 alone"),
        ("rows: 6", "rows: ６", "write 6, in the digits 0 to 9 alone"),
        ("-8]", "−8]", "the character minus sign: write -8 with a hyphen"),
        ("-8]", "–8]", "the character en dash: write -8 with a hyphen"),
        ("square_mm: 25}", "square_mm: '25,4'}", "write 25.4 with a decimal point"),
        ("square_mm: 25}", "square_mm: 25,4}", "write square_mm: 25.4 with a decimal point"),
        ("_mm: 50", "_mm: 50+-5", "write {value: 50, sigma: 5}"),
        ("_mm: 50", "_mm: 50 ± 5", "write {value: 50, sigma: 5}"),
        ("square_mm: 25", "square_mm: 25 mm", "write 25 without a unit"),
        ("square_mm: 25", "square_mm: 2.5cm", "write 25 without a unit"),
        ("square_mm: 25", 'square_mm: 1"', "write 25.4 without a unit"),
        ("square_mm: 25}", "square_mm: '2,5 cm'}", "write 25 without a unit"),
        ("_mm: 50", "_mm: 50,5 mm", "write 50.5 without a unit"),
        ("_mm: 50", "_mm: 5 cm ± 0,2 cm", "write {value: 50, sigma: 2}"),
        ("_mm: 50", "_mm: 5 ± 0.2 cm", "write {value: 50, sigma: 2}"),
        ("index: 1.49", "index: Acrylic", "write 1.49, its refractive index"),
        ("index: 1.49", "index: 1.49\n  outside_index: sea water", "write 1.34, its refractive"),
        ("width: 960", "width: 960 px", "camera.width is .*: write 960 without a unit"),
        ("width: 960", "width: '960,5'", "camera.width is .*: write a whole number from 1 to"),
        (
            "960, height",
            "960, shutter: {type: rolling, readout_ms: 30 ms}, height",
            "write 30 with",
        ),
        ("-8]", "-0.8 cm]", "write -8 without a unit"),
        ("columns: 9", "columns:9", "write columns: 9, with a space behind the colon."),
        ("rows: 6", "rows:\u00a06", "write rows: 6, with a space behind the colon, not a no-break"),
        ("board: {", "board:\u00a0{", "line 2: .* a no-break space: type a plain space"),
        ("board: {", "board:\u200b{", "line 2: .* a zero width space: delete it"),
        (BOARD, "board:\ncolumns: 9\nrows: 6", "columns is a key of board: indent its line"),
        (DOME, DOME.replace("\n  ", "\n"), "shape is a key of cover: indent its line"),
        (BOARD, "board:\n  columns: 9\n   rows: 6", "line 4: .*begin the keys of one section in"),
        ("square_mm: 25", "square_mm: wide", "write a number from 0.05 to 100000 in millimetres"),
        ("rows: 6", "rows: 50+-5", "write a whole number from 3 to 1000"),
        ("_mm: 50", "_mm: {value: 50, sigma: 5+-1}", "write a number above 0"),
        ("rows: 6", "row: 6", "row is not a known key .did you mean rows"),
    ],
)
def test_a_number_is_spelled_out(written: str, instead: str, says: str, tmp_path: Path) -> None:
    assert written in TEXT
    file = tmp_path / "session.yaml"
    file.write_text(TEXT.replace(written, instead), encoding="utf-8")
    with pytest.raises(InputError, match=says):
        read_session(tmp_path)


def test_an_intrinsic_number_is_indented(tmp_path: Path) -> None:
    file = tmp_path / "session.yaml"
    camera = "camera:\n  width: 960\n  height: 720\n  intrinsics:\n  fx: 900\ncover: {shape: none}"
    file.write_text(f"format: 1\n{BOARD}\n{camera}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"camera\.fx is a key of camera\.intrinsics: indent"):
        read_session(tmp_path)


def test_the_text_itself_is_a_session(tmp_path: Path) -> None:
    (tmp_path / "session.yaml").write_text(TEXT, encoding="utf-8")
    assert {*read_yaml(tmp_path / "session.yaml")} == {"format", "board", "camera", "cover"}
    with pytest.raises(InputError, match="has no pictures"):
        read_session(tmp_path)
