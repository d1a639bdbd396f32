"""The export screen: its inputs, its message about the files, and leaving it while the
export runs.
"""

import argparse
import re
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from threading import Event

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Select

from calib.export.formats import BRIEF, FORMATS
from capture.tui.command import CommandResult, calib
from capture.tui.export import (
    FURTHER,
    NO_DEPTH,
    STRAIGHT,
    USUAL,
    WATERS,
    ExportScreen,
    parse_depths,
    warn_of_distance,
)
from capture.tui.mirror import describe_screen
from tests.capture.tui.driving import drive, running, see, shown, until, write


def test_leaving_during_an_export_is_answered_when_it_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave = Event()
    calls: list[Sequence[str]] = []

    def slow(arguments: Sequence[str]) -> CommandResult:
        calls.append(arguments)
        assert leave.wait(60)
        return CommandResult(0, f"{tmp_path / 'export' / 'map_1m.npz'}\n", "", ())

    monkeypatch.setattr("capture.tui.export.calib", slow)
    drive(_leave(tmp_path, leave))
    assert [words[0] for words in calls] == ["export"]


async def _leave(session: Path, leave: Event) -> None:
    calibration = session / "calibration"
    calibration.mkdir()
    (calibration / "calibration.yaml").touch()
    async with running(session, notices=True) as pilot:
        pilot.app.push_screen(ExportScreen(session, calibration, 1.0))
        await see(pilot, "depths in metres")
        await pilot.press("ctrl+s")
        await see(pilot, "Being written")
        await pilot.press("escape")
        await see(pilot, "Where pictures come from")
        assert "Wrote" not in shown(pilot)
        leave.set()
        await see(pilot, "Wrote map_1m.npz")
        assert f"Exported {session / 'export' / 'map_1m.npz'}" in pilot.app.farewell  # type: ignore[attr-defined]


@pytest.mark.parametrize("place", ["depths", "form", "export"])
def test_q_quits_as_on_the_pages(place: str, tmp_path: Path) -> None:
    drive(_quit(tmp_path, place))


async def _quit(session: Path, place: str) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ExportScreen(session, session / "calibration", 1.0))
        await see(pilot, "depths in metres")
        pilot.app.screen.query_one(f"#{place}").focus()
        await pilot.press("q")
        await until(pilot, lambda: not pilot.app.is_running)


def test_q_is_a_letter_of_a_folder_until_the_maps_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_map(_: Sequence[str]) -> CommandResult:
        return CommandResult(0, f"{tmp_path / 'q' / 'map_1m.npz'}\n", "", ())

    monkeypatch.setattr("capture.tui.export.calib", write_map)
    drive(_quit_at_end(tmp_path))


async def _quit_at_end(session: Path) -> None:
    async with running(session, size=(120, 40)) as pilot:
        pilot.app.push_screen(ExportScreen(session, session / "calibration", 1.0))
        await see(pilot, "depths in metres")
        folder = pilot.app.screen.query_one("#folder", Input)
        folder.value = ""
        folder.focus()
        await pilot.press("q", "ctrl+s")
        assert folder.value == "q"
        await see(pilot, "That is all: esc goes back to the results, q quits.")
        await pilot.press("q")
        await until(pilot, lambda: not pilot.app.is_running)


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("", []),
        ("0.5 1", ["0.5", "1"]),
        ("0.5, 1", ["0.5", "1"]),
        (" 1.0 ,\t2, ", ["1.0", "2"]),
        ("inf", ["inf"]),
    ],
)
def test_depths_are_a_list(text: str, read: list[str]) -> None:
    assert parse_depths(text) == read


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("1,5", "'1,5' may be one depth or more: write 1.5 with a point, or 1 5 for two depths"),
        ("2 0,5", "write 0.5 with a point"),
        ("0.5,1", "a blank between two depths"),
        ("0,5,1,5", "write decimals with a point"),
        (",5", "write decimals with a point"),
        ("0.5m", "is not a depth"),
    ],
)
def test_a_possible_decimal_comma_causes_a_question(text: str, advice: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=re.escape(advice)):
        parse_depths(text)


@pytest.mark.parametrize(
    ("listed", "text"),
    [
        ([], ""),
        (["0.5", "3.3", "0.19", "inf"], ""),
        (
            ["50"],
            (
                "50 m is far from your boards, which were 0.25 to 1.10 m away: press ^s again to"
                " export all the same."
            ),
        ),
        (
            ["1", "0.08", "150"],
            (
                "0.08 m and 150 m are far from your boards, which were 0.25 to 1.10 m away: press"
                " ^s again to export all the same."
            ),
        ),
    ],
)
def test_depths_that_the_boards_do_not_support_are_reported(listed: list[str], text: str) -> None:
    assert warn_of_distance(listed, (0.25, 1.1)) == text


def test_a_depth_far_from_every_board_is_asked_about_once(
    tmp_path: Path, calls: list[Sequence[str]]
) -> None:
    drive(_far(tmp_path, calls))


async def _far(session: Path, calls: list[Sequence[str]]) -> None:
    async with running(session) as pilot:
        pilot.app.push_screen(ExportScreen(session, session / "calibration", 1.0, (0.25, 1.1)))
        await see(pilot, "depths in metres")
        await write(pilot, "50")
        await pilot.press("ctrl+s")
        await see(pilot, "50 m is far from your boards, which were 0.25 to 1.10 m away")
        assert not calls
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote rays.npz map_50m.npz")


def test_every_form_has_a_line_that_the_list_has_room_for() -> None:
    long = [form.name for form in FORMATS if len(form.brief or form.summary) > BRIEF]
    assert not long


def test_a_form_that_is_not_usual_is_one_choice_away(
    tmp_path: Path, calls: list[Sequence[str]]
) -> None:
    drive(_further(tmp_path))
    assert calls[0][3] == "colmap"


async def _further(session: Path) -> None:
    async with exporting(session) as pilot:
        form, further = pilot.app.screen.query(Select)
        assert [value for _, value in form._options] == [*USUAL, FURTHER]
        offered = {value for _, value in [*form._options, *further._options]}
        assert offered == {*(each.name for each in FORMATS), FURTHER}
        assert "which form" not in shown(pilot)
        await pilot.press("tab", "enter", "end", "enter")
        await see(pilot, "which form")
        await pilot.press("tab", "enter", "c", "o", "enter")
        await see(pilot, "cameras.txt")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote")


@asynccontextmanager
async def exporting(session: Path, *, notices: bool = False) -> AsyncIterator[Pilot[None]]:
    async with running(session, notices=notices) as pilot:
        pilot.app.push_screen(ExportScreen(session, session / "calibration", 1.0))
        await see(pilot, "depths in metres")
        yield pilot


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """The arguments for `calib`, which is a separate command and writes here what it reports."""
    calls: list[Sequence[str]] = []

    def export(arguments: Sequence[str]) -> CommandResult:
        calls.append(arguments)
        folder = Path(arguments[arguments.index("-o") + 1])
        at = arguments[arguments.index("--depth") + 1 :] if "--depth" in arguments else []
        return CommandResult(
            0,
            "\n".join(
                map(str, [folder / "rays.npz", *(folder / f"map_{depth}m.npz" for depth in at)])
            ),
            "",
            (),
        )

    monkeypatch.setattr("capture.tui.export.calib", export)
    return calls


def test_an_invalid_export_writes_nothing(tmp_path: Path, calls: list[Sequence[str]]) -> None:
    drive(_refuse(tmp_path))
    assert not calls


async def _refuse(session: Path) -> None:
    async with exporting(session) as pilot:
        await write(pilot, "1,5")
        await pilot.press("ctrl+s")
        await see(pilot, "write 1.5 with a point, or 1 5 for two")
        await pilot.press("shift+tab")
        await write(pilot, "1.5")
        await pilot.press("tab")
        await write(pilot, "")
        await pilot.press("ctrl+s")
        await see(pilot, "No folder is named")
        await pilot.press("shift+tab")
        await write(pilot, "~nobody-by-this-name/maps")
        await pilot.press("ctrl+s")
        await see(pilot, "of an unknown user")


def test_a_home_is_found_and_the_whole_folder_named(
    tmp_path: Path, calls: list[Sequence[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/home/of-me")
    drive(_at_home(tmp_path))
    (words,) = calls
    assert words[words.index("-o") + 1] == "/home/of-me/maps"


async def _at_home(session: Path) -> None:
    async with exporting(session) as pilot:
        await write(pilot, "0.5, 2")
        await pilot.press("tab")
        await write(pilot, "~/maps")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote rays.npz map_0.5m.npz map_2m.npz")
        await see(pilot, "in /home/of-me/maps")
        await see(pilot, "That is all")


def test_an_export_without_a_depth_reports_that_there_is_no_map(
    tmp_path: Path, calls: list[Sequence[str]]
) -> None:
    drive(_no_depth(tmp_path))
    assert "--depth" not in calls[0]


async def _no_depth(session: Path) -> None:
    async with exporting(session) as pilot:
        await write(pilot, "")
        await pilot.press("ctrl+s")
        await see(pilot, "No map, as no depth was named.")
        assert "Wrote rays.npz " in shown(pilot)
        assert "That is all" not in shown(pilot)


def test_the_pictures_of_the_session_are_made_straight(
    tmp_path: Path, calls: list[Sequence[str]]
) -> None:
    (tmp_path / "frames").mkdir()
    drive(_straight(tmp_path))
    before = ["undistort", str(tmp_path / "calibration"), str(tmp_path / "frames")]
    assert calls == [
        [*before, "-o", str(tmp_path / "export" / f"straight_{depth}m"), "--depth", depth]
        for depth in ("0.5", "1")
    ]


async def _straight(session: Path) -> None:
    async with running(session) as pilot:
        screen = ExportScreen(session, session / "calibration", 1.0, pictures=session / "frames")
        pilot.app.push_screen(screen)
        await see(pilot, "depths in metres")
        screen.query_one("#form", Select).value = STRAIGHT
        await write(pilot, "")
        await pilot.press("shift+tab", "ctrl+s")
        await see(pilot, NO_DEPTH)
        await write(pilot, "0.5 1")
        await pilot.press("shift+tab", "ctrl+s")
        await see(pilot, "That is all")


BAR = "Rays and maps          ━━━━━━━━━━━━━━━━━━━━    3/3    0:00:00  "
NOTES = (
    "opencv: off by 0.225 px RMS at 1 m, with 12 coefficients.",
    "Take care: the camera model is off by up to 0.50 px.",
    "Note: 3 % of the straight picture is black.",
)


@pytest.mark.parametrize("code", [0, 2])
def test_the_remarks_of_the_command_are_shown_and_its_bars_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    lines = [BAR, *NOTES, *["calib: error: no space."][:code]]
    program = tmp_path / "python"
    program.write_text(
        "#!/bin/sh\n" + "".join(f"echo '{line}' >&2\n" for line in lines) + f"exit {code}\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(program))
    result = calib([])
    assert result.remarks == list(NOTES)
    assert result.sentence == ("no space." if code else "")


@pytest.mark.parametrize("has_border", [True, False])
def test_the_black_border_of_straight_pictures_is_cropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_border: bool
) -> None:
    (tmp_path / "frames").mkdir()
    calls: list[Sequence[str]] = []

    def write_pictures(arguments: Sequence[str]) -> CommandResult:
        calls.append(arguments)
        return CommandResult(0, f"{tmp_path / '0.png'}\n", "", ())

    monkeypatch.setattr("capture.tui.export.calib", write_pictures)
    drive(_write_straight(tmp_path, has_border))
    assert [" ".join(words).endswith("--depth 1 --crop 0") for words in calls] == [has_border]


async def _write_straight(session: Path, has_border: bool) -> None:
    frames = session / "frames"
    async with running(session) as pilot:
        screen = ExportScreen(
            session, session / "calibration", 1.0, pictures=frames, has_black_border=has_border
        )
        pilot.app.push_screen(screen)
        await see(pilot, "depths in metres")
        screen.query_one("#form", Select).value = STRAIGHT
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote 1 straight picture")


@pytest.mark.parametrize("form", ["npz", STRAIGHT])
def test_remarks_stand_below_the_result_and_scroll(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    (tmp_path / "frames").mkdir()
    remarks = [*NOTES, *(f"Note: {number}, {'word ' * 20}." for number in range(5))]
    written = f"{tmp_path / 'map_1m.npz'}\n"
    monkeypatch.setattr(
        "capture.tui.export.calib", lambda _: CommandResult(0, written, "", remarks)
    )
    drive(_with_remarks(tmp_path, form))


async def _with_remarks(session: Path, form: str) -> None:
    async with running(session) as pilot:
        screen = ExportScreen(session, session / "calibration", 1.0, pictures=session / "frames")
        pilot.app.push_screen(screen)
        await see(pilot, "depths in metres")
        screen.query_one("#form", Select).value = form
        await pilot.press("ctrl+s")
        await see(pilot, "Take care: the camera model is off by up to 0.50 px.")
        assert "Note: 4, " not in shown(pilot)
        await pilot.press(*["pagedown"] * 6)
        await see(pilot, "Note: 4, ")


@pytest.mark.parametrize("form", sorted(WATERS))
def test_a_calibration_in_air_has_maps_for_water(
    tmp_path: Path, calls: list[Sequence[str]], form: str
) -> None:
    """The calibration in water lies beside its maps; the table of `calib immerse` is no file."""
    drive(_in_water(tmp_path, form))
    immersed = str(tmp_path / "export" / form / "calibration")
    calibration = str(tmp_path / "calibration")
    maps = ["--format", "npz", "-o", str(tmp_path / "export" / form), "--depth", "1"]
    assert calls == [
        ["immerse", calibration, "--outside-index", WATERS[form], "-o", immersed],
        ["export", immersed, *maps],
    ]


async def _in_water(session: Path, form: str) -> None:
    async with running(session) as pilot:
        screen = ExportScreen(session, session / "calibration", 1.0, in_air=True)
        pilot.app.push_screen(screen)
        await see(pilot, "These maps are for air")
        screen.query_one("#form", Select).value = FURTHER
        screen.query_one(f"#{FURTHER}", Select).value = form
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote rays.npz map_1m.npz")


def test_a_late_success_does_not_hide_the_current_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changed = Event()

    def slow(arguments: Sequence[str]) -> CommandResult:
        del arguments
        assert changed.wait(60)
        return CommandResult(0, f"{tmp_path / 'map_1m.npz'}\n", "", ())

    monkeypatch.setattr("capture.tui.export.calib", slow)
    drive(_late(tmp_path, changed))


async def _late(session: Path, changed: Event) -> None:
    async with exporting(session) as pilot:
        await pilot.press("ctrl+s")
        await see(pilot, "Being written")
        await pilot.press("end", "m")
        await see(pilot, "'1m' is not a depth")
        changed.set()
        await until(
            pilot,
            lambda: any("Wrote map_1m.npz" in item.message for item in pilot.app._notifications),
        )
        assert "'1m' is not a depth" in shown(pilot)


def test_the_program_can_be_ended_from_here(tmp_path: Path) -> None:
    """A page for a thumb has Quit in its menu on every screen."""
    drive(_end(tmp_path))


async def _end(session: Path) -> None:
    async with exporting(session) as pilot:
        keys: list[dict[str, str]] = describe_screen(pilot.app)["keys"]  # type: ignore[assignment]
        assert [key["key"] for key in keys if key["label"] == "Quit"] == ["ctrl+q"]


def test_the_next_command_has_the_depth_of_the_last_export(
    tmp_path: Path, calls: list[Sequence[str]]
) -> None:
    drive(_twice(tmp_path))
    assert len(calls) == 2


async def _twice(session: Path) -> None:
    (session / "calibration").mkdir()
    (session / "calibration" / "calibration.yaml").touch()
    async with exporting(session) as pilot:
        for depths in ("500", "0.5 1"):
            await write(pilot, depths)
            await pilot.press("shift+tab", "ctrl+s")
            await see(pilot, f"map_{depths.split()[-1]}m.npz")
        *lines, following = pilot.app.farewell  # type: ignore[attr-defined]
    assert [Path(line.split()[-1]).name for line in lines[1:]] == [
        "map_0.5m.npz",
        "map_1m.npz",
        "map_500m.npz",
        "rays.npz",
    ]
    assert " --depth 0.5 " in following
