"""Values of a session that was begun are corrected in the form."""

from pathlib import Path

import pytest
import yaml
from textual.widgets import Input, Select

from calib.errors import InputError
from capture.session_file import read_setup
from capture.tui.form import FormTexts, write_form
from capture.tui.session_edit import write_edits
from tests.capture.tui.driving import drive, running, see, shown, until

WRITTEN = """\
# my own camera
format: 1
board:  # measured twice
  columns: 9
  rows: 9      # inner corners
  square_mm: 20.0
camera: {width: 820, height: 616}
cover:
  shape: cone
  inner_radius_mm: {value: 41.95, sigma: 2.0}
  radius_slope: -0.105
  axis_offset_mm: [0.0, -30.0]  # x, z
  thickness_mm: 3.0
  refractive_index: 1.5
"""


def session_of(folder: Path, text: str) -> tuple[Path, FormTexts]:
    (folder / "session.yaml").write_text(text)
    board, _, cover = read_setup(folder / "session.yaml")
    return folder, write_form(board, cover)


def changed(shown: FormTexts, board: dict[str, str], cover: dict[str, str]) -> FormTexts:
    return FormTexts(
        {**shown.board, **board}, shown.shape, {**shown.cover, **cover}, shown.kind, shown.outer
    )


def test_only_the_corrected_values_change(tmp_path: Path) -> None:
    session, shown = session_of(tmp_path, WRITTEN)
    assert not write_edits(session, shown)
    assert (session / "session.yaml").read_text() == WRITTEN
    typed = changed(
        shown,
        {"rows": "6", "square_mm": "20.5"},
        {"inner_radius_mm": "43 ± 1", "axis_offset_mm": "1, -31"},
    )
    assert write_edits(session, typed)
    assert (session / "session.yaml").read_text() == (
        WRITTEN.replace("rows: 9 ", "rows: 6 ")
        .replace("square_mm: 20.0", "square_mm: 20.5")
        .replace("{value: 41.95, sigma: 2.0}", '{"value": 43.0, "sigma": 1.0}')
        .replace("[0.0, -30.0]", "[1.0, -31.0]")
    )
    board, _, cover = read_setup(session / "session.yaml")
    assert write_form(board, cover) == typed


@pytest.mark.parametrize("style", [True, False, None], ids=["flow", "block", "mixed"])
def test_every_style_of_yaml_is_corrected(style: bool | None, tmp_path: Path) -> None:
    document = yaml.safe_load(WRITTEN) | {"corners": "corners.vnl"}
    session, shown = session_of(tmp_path, yaml.safe_dump(document, default_flow_style=style))
    typed = changed(shown, {"columns": "11"}, {"thickness_mm": "2.5 ± 0.1", "tilt_deg": "1, 0"})
    assert write_edits(session, typed)
    board, camera, cover = read_setup(session / "session.yaml")
    assert write_form(board, cover) == typed
    assert (camera.width, camera.height) == (820, 616)
    assert yaml.safe_load((session / "session.yaml").read_text())["corners"] == "corners.vnl"


def test_another_shape_replaces_the_cover_alone(tmp_path: Path) -> None:
    session, shown = session_of(tmp_path, WRITTEN)
    cover = {"distance_mm": "25", "tilt_deg": "", "thickness_mm": "6", "refractive_index": "1.5"}
    assert write_edits(session, FormTexts(shown.board, "flat", {**cover, "outside_index": ""}))
    board, _, now = read_setup(session / "session.yaml")
    assert now.shape == "flat"
    assert str(board) == "9x9"


def test_a_wrong_value_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    session, shown = session_of(tmp_path, WRITTEN)
    with pytest.raises(InputError, match="square_mm"):
        write_edits(session, changed(shown, {"square_mm": "0.02"}, {}))
    assert (session / "session.yaml").read_text() == WRITTEN


def test_a_value_is_corrected_after_the_first_start(brief: Path) -> None:
    drive(_corrected(brief))
    board, _, cover = read_setup(brief / "session.yaml")
    assert board.square == pytest.approx(0.0205)
    assert cover.shape == "cone"


async def _corrected(session: Path) -> None:
    async with running(session, f"folder:{session}") as pilot:
        await see(pilot, "continued")
        square = next(
            field
            for field in pilot.app.screen.query("#board Input").results(Input)
            if field.name == "square_mm"
        )
        assert not square.disabled
        assert not pilot.app.screen.query_one("#shape", Select).disabled
        square.value = "0.02"
        await pilot.press("ctrl+s")
        await until(pilot, lambda: pilot.app.screen.focused is square)
        assert "if metres were meant" in " ".join(shown(pilot).split())
        square.value = "20.5"
        await pilot.press("ctrl+s")
        await see(pilot, "no more pictures")
        await pilot.press("escape")
        await see(pilot, "square_mm 20.5")
