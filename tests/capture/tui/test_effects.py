"""The text of a diagnosis on the screen, and how the person goes on with the effects."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

from calib.calibration import Calibration
from calib.diagnosis.finding import Candidate, Diagnosis, ParameterEstimate
from calib.fit_record.history import Quality
from calib.progress import Silent
from capture.tui.diagnosing import as_text
from capture.tui.fitting import open_results
from tests.capture.tui.driving import drive, running, see, shown, write

BOW = Candidate(
    effect="board_shape",
    form="",
    chi2=2838.0,
    dof=2,
    p_value=0.0,
    absorbed=0.0,
    held_out_px_before=0.59,
    held_out_px_after=0.17,
    gain_ci95=(0.3, 0.5),
    parameters={"board_shape.xx": ParameterEstimate(0.001002, 3.3e-6, "m")},
    confounded_with=(),
    accepted=True,
    verdict="found",
)
FOCAL = Candidate("focal", "", 1.0, 1, 0.4, 0.99, None, None, None, {}, (), False, "absorbed")
FINDING = Diagnosis(
    noise_px=0.08,
    noise_from="the residual's short-scale part",
    residual=(),
    candidates=(BOW, FOCAL),
    accepted=("board_shape",),
    base_quality=Quality(0.6, 0.05, 0.59),
    final_quality=Quality(0.1, 0.01, 0.17),
    unexplained=0.0,
    organised_by="",
    remarks=("these views do not tell focal from thickness.",),
)
NUMBERS = [["board_shape.xx 1.0020 ± 0.0033 mm"]]
WORDS = {
    "board_shape": "The board is not flat.",
    "focal": "The focal length is not as stated, which is said here in many more words.",
}
SESSION = Path(__file__).parents[3] / "fixtures" / "stretch"


def test_accepted_effects_are_shown_with_the_errors_before_and_after() -> None:
    lines = as_text(FINDING, NUMBERS, WORDS).splitlines()
    assert lines[0] == "Found: board_shape."
    assert lines[5].split() == ["held-out", "views", "0.590", "px", "0.170", "px"]
    assert NUMBERS[0][0] in lines
    place = lines.index("board_shape                0.590 to 0.170 px")
    assert lines[place + 1] == "  found"
    assert "No sign of these in what is left: focal." in lines
    assert lines[-1] == "Note: these views do not tell focal from thickness."
    tried = replace(FOCAL, held_out_px_before=0.17, held_out_px_after=0.16)
    lines = as_text(replace(FINDING, candidates=(BOW, tried)), NUMBERS, WORDS).splitlines()
    assert lines[-2:] == ["", f"focal: {WORDS['focal']}"]
    assert not any("No sign of these" in line for line in lines)
    rows = [line for line in lines if re.search(r"\S {2}", line)]
    assert len(rows) == 8
    assert max(map(len, rows)) <= 45, "a phone shows longer rows in letters that are too small"


def test_people_are_told_in_plain_words_and_programs_as_ever() -> None:
    assert FOCAL.outcome == "these views cannot tell it from fitted numbers"
    assert [
        candidate["verdict"]
        for candidate in FINDING.as_json()["candidates"]
        if candidate["effect"] == "focal"
    ] == ["absorbed"]


def test_a_diagnosis_without_effects_is_reported_as_a_result() -> None:
    nothing = Diagnosis(
        0.08, "", (), (), (), Quality(0.1, 0.01, 0.1), Quality(0.1, 0.01, 0.1), 0.0, "", ()
    )
    assert as_text(nothing).startswith("Nothing found: no known effect improves")
    undecided = as_text(replace(nothing, decided=False))
    assert undecided.startswith("Not decided: there are too few views to confirm a cause.")
    assert "\nfitted  " not in as_text(nothing)


@pytest.mark.slow
def test_a_stretched_print_is_found_and_exported(tmp_path: Path) -> None:
    session = tmp_path / "session"
    session.mkdir()
    shutil.copytree(SESSION / "frames", session / "frames")
    shutil.copy(SESSION / "session.yaml", session)
    drive(_stretch(session))
    drive(_again(session))
    diagnosed = Calibration.load(session / "calibration" / "diagnosed")
    other_stage = replace(diagnosed.stages[0], rms_px=2 * diagnosed.stages[0].rms_px)
    replace(diagnosed, stages=(other_stage, *diagnosed.stages[1:])).save(
        session / "calibration" / "diagnosed"
    )
    opened = open_results(Silent(), session / "calibration")  # of another fit, as it were
    assert opened["calibration"] == str(session / "calibration" / "calibration.yaml")


async def _stretch(session: Path) -> None:
    async with running(session, f"folder:{SESSION}") as pilot:
        await see(pilot, "continued")
        await pilot.press("ctrl+s")
        await see(pilot, "24 views")
        await pilot.press("f")
        await see(pilot, "Press e to find faults")
        await pilot.press("e")
        await see(pilot, "Diagnosis")
        await see(pilot, "Found: board_scale.")
        assert _numbers(pilot, "held-out views")[1] < _numbers(pilot, "held-out views")[0] / 4
        await see(pilot, "enter Use them")
        await pilot.press("enter")
        await see(pilot, "effects found")
        assert "on board before" not in shown(
            pilot
        )  # the fit's own numbers are stages of the same table
        assert "the model lacks" not in " ".join(shown(pilot).split())
        await pilot.press("x")
        await see(pilot, "Maps that undistort pictures")
        await write(pilot, "1")
        await pilot.press("ctrl+s")
        await see(pilot, "Wrote rays.npz map_1m.npz")
    assert (session / "export" / "map_1m.npz").exists()


async def _again(session: Path) -> None:
    """The effects are there when the session is opened again."""
    async with running(session) as pilot:
        await see(pilot, "^o opens its results")
        await pilot.press("ctrl+o")
        await see(pilot, "effects found")
        assert "on board before" not in shown(
            pilot
        )  # the fit's own numbers are stages of the same table


def _numbers(pilot: Pilot[None], words: str) -> list[float]:
    line = next(line for line in shown(pilot).splitlines() if line.strip().startswith(words))
    return [float(piece) for piece in line.split() if piece[0].isdigit()]
