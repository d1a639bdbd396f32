"""The way from a result or a failed fit to the field of the set-up that corrects it."""

import shutil
from pathlib import Path

import pytest
import yaml
from textual.widgets import Input

from calib.session.shapes.registry import find_shape, stated_shape_names
from capture.tui.board_and_cover import BoardAndCover
from capture.tui.corrected_fields import (
    in_form_words,
    list_labels,
    named_fields,
    suspected_fields,
)
from capture.tui.effects import EffectsScreen
from capture.tui.fit import FitScreen
from capture.tui.mirror import describe_screen
from capture.tui.results import ResultsScreen
from tests.capture.tui.driving import drive, running, see, shown, until, write
from tests.capture.tui.test_session import FIXTURE
from tests.capture.tui.test_snapshots import RESULT, take_over

FORBIDDEN = {
    "word": "do_not_use",
    "sentences": ["Do not use it.", "The board would be 16 mm wide: check board.square_mm."],
    "fields": ("square_mm",),
}
WRONG_BOARD = (
    "the pictures show a board of 9x9 inner corners: write board.columns: 9, board.rows: 9 in"
    " session.yaml, or call calib fit with --board 9x9."
)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "session"
    shutil.copytree(FIXTURE, folder, ignore=shutil.ignore_patterns("truth.npz"))
    return folder


@pytest.mark.parametrize("shape", stated_shape_names())
def test_every_number_of_a_cover_leads_to_its_field(shape: str) -> None:
    for dimension in find_shape(shape).keys:
        for name in dimension.quantity.names:
            fields = suspected_fields([f"cover.{name}"], shape, has_lens=True)
            assert fields == (dimension.quantity.key,)


@pytest.mark.parametrize(
    ("suspects", "fields"),
    [
        (["board.square_mm", "board.rows"], ("square_mm", "rows")),
        (["cover.tilt.x", "cover.tilt.y", "cover.shape"], ("tilt_deg", "shape")),
        (["cover.layer2.thickness"], ("thickness_mm",)),
        (["cover2.thickness", "board_shape", "frames"], ()),
    ],
)
def test_suspects_lead_to_fields(suspects: list[str], fields: tuple[str, ...]) -> None:
    assert suspected_fields(suspects, "flat", has_lens=False) == fields


@pytest.mark.parametrize("has_lens", [True, False])
def test_a_lens_is_replaced_only_where_one_is_declared(has_lens: bool) -> None:
    fields = suspected_fields(["camera.fx", "camera.fy"], "flat", has_lens=has_lens)
    assert fields == (("like",) if has_lens else ())


@pytest.mark.parametrize(
    ("sentence", "words", "fields"),
    [
        (
            WRONG_BOARD,
            (
                "the pictures show a board of 9x9 inner corners: write columns: 9, rows: 9 in the"
                " set-up."
            ),
            ("columns", "rows"),
        ),
        (
            "the markers are larger: correct board in session.yaml, or show it alone.",
            "the markers are larger: correct board in the set-up, or show it alone.",
            ("kind",),
        ),
        ("no corner is sharp: show more.", "no corner is sharp: show more.", ()),
    ],
)
def test_an_error_names_fields(sentence: str, words: str, fields: tuple[str, ...]) -> None:
    assert in_form_words(sentence) == words
    assert named_fields(sentence) == fields


def test_the_labels_are_those_of_the_form(tmp_path: Path) -> None:
    drive(_labels(tmp_path / "session"))


async def _labels(session: Path) -> None:
    async with running(session) as pilot:
        await see(pilot, "Fill in what is needed")
        assert pilot.app.screen.query_one(BoardAndCover).filled
        for field in ("kind", "shape", "like", "columns", "square_mm", "thickness_mm"):
            assert list_labels([field]) in shown(pilot)


def test_a_result_leads_to_the_field_and_on_to_the_next_fit(session: Path) -> None:
    drive(_correct(session))
    assert yaml.safe_load((session / "session.yaml").read_text())["board"]["square_mm"] == 21


async def _correct(session: Path) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ResultsScreen(session, {**RESULT, "verdict": FORBIDDEN}))
        await see(
            pilot, "Press s to correct square_mm in the set-up, r for the report, which says more."
        )
        await see(pilot, "s Set-up")
        keys = describe_screen(pilot.app)["keys"]
        assert isinstance(keys, list)
        assert [key["label"] for key in keys if key["main"]] == ["Set-up"]
        await pilot.press("s")
        await see(
            pilot,
            "The board would be 16 mm wide: check square_mm. Then press ^r to fit again.",
        )
        await until(pilot, lambda: _focused(pilot.app.screen.focused) == "square_mm")
        await write(pilot, "21")
        await pilot.press("ctrl+r")
        await until(pilot, lambda: isinstance(pilot.app.screen, FitScreen))


def test_every_page_leads_back_to_the_values(session: Path) -> None:
    drive(_back(session))


async def _back(session: Path) -> None:
    """One key leads to the first value of the board, although nothing is known to be wrong."""
    verdict = {**FORBIDDEN, "fields": ()}
    async with running(session, f"folder:{session / 'frames'}") as pilot:
        results = ResultsScreen(session, {**RESULT, "verdict": verdict})
        effects = EffectsScreen(session / "calibration" / "calibration.yaml")
        effects.action_again = lambda: None  # type: ignore[method-assign]
        fit = FitScreen(session)
        fit.action_again = lambda: None  # type: ignore[method-assign]
        for page in (results, effects, fit):
            await pilot.app.push_screen(page)
            await see(pilot, "s Set-up")
            keys = describe_screen(pilot.app)["keys"]
            assert isinstance(keys, list)
            assert "Set-up" not in [key["label"] for key in keys if key["main"]]
            await pilot.press("s")
            await see(pilot, "change what is wrong. Then ^r fits again, ^s records.")
            await until(pilot, lambda: _focused(pilot.app.screen.focused) == "columns")
        await pilot.press("ctrl+s")
        await see(pilot, "[THROUGH COVER]")
        await pilot.press("s")
        await see(pilot, "change what is wrong. Then ^r fits again, ^s records.")
        await until(pilot, lambda: _focused(pilot.app.screen.focused) == "columns")


def test_a_failed_fit_leads_to_the_field(session: Path) -> None:
    drive(_refused(session))


async def _refused(session: Path) -> None:
    async with running(session) as pilot:
        screen = FitScreen(session)
        await pilot.app.push_screen(screen)
        child = take_over(screen)
        event = {"event": "error", "sentence": WRONG_BOARD}
        screen.post_message(FitScreen.ProcessReported(child, event))
        await see(pilot, "write columns: 9, rows: 9 in the set-up.")
        await see(pilot, "Press s to correct columns or rows in the set-up, esc to go back.")
        await pilot.press("s")
        await see(pilot, "in the set-up. Then press ^r to fit again.")
        await until(pilot, lambda: _focused(pilot.app.screen.focused) == "columns")


def _focused(widget: object) -> str | None:
    return widget.name if isinstance(widget, Input) else None
