"""All that a diagnosis considered fits into 60 columns, which a phone shows in full: every figure,
and what became of each effect.
"""

import re

import pytest

from calib.calibration import Calibration
from calib.commands.diagnosis_table import print_diagnosis
from calib.diagnosis.finding import Candidate, Diagnosis
from calib.effects.registry import KINDS
from calib.fit_record.history import Quality
from fixtures.known import known
from fixtures.synthetic import HEIGHT, WIDTH, scene

VERDICTS = (
    "absorbed",
    "not confirmed",
    "fails at other depths",
    "not asked for",
    "too many numbers for what it explains",
    "not finite",
)


def candidate(effect: str, verdict: str, *, fitted: bool) -> Candidate:
    initial, final, gain = (10.252, 10.017, (-0.202, 12.265)) if fitted else (None, None, None)
    form = "water" if effect == "flat_port" else ""
    return Candidate(
        effect, form, 123456.0, 144, 2e-10, 0.5, initial, final, gain, {}, (), False, verdict
    )


@pytest.fixture(scope="module")
def plain() -> Calibration:
    return known(scene(1, views=1), WIDTH, HEIGHT)


def test_the_table_is_narrow_and_lists_effects_by_outcome(
    plain: Calibration, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    candidates = tuple(
        candidate(kind.name, VERDICTS[i % len(VERDICTS)], fitted=i % 2 == 0)
        for i, kind in enumerate(KINDS)
    )
    same = Quality(0.224, 0.0177, 0.282)
    print_diagnosis(Diagnosis(0.016, "", (), candidates, (), same, same, 0.0, "", ()), plain)
    lines = capsys.readouterr().out.splitlines()
    table = lines[
        next(i for i, line in enumerate(lines) if line.startswith("What was considered")) :
    ]
    assert max(map(len, table)) <= 60
    text: dict[str, str] = {}
    heading = ""
    for line in table[2:]:
        if line.startswith("  "):
            text[heading] = f"{text.get(heading, '')} {' '.join(line.split())}"
        else:
            heading = line.rstrip(":")
    for item in candidates:
        figures = " 10.252 → 10.017 -0.202 to 12.265" if item.held_out_px_after else ""
        assert re.search(
            rf" {re.escape(item.title)}{re.escape(figures)}(,|$| )", text[item.outcome]
        )


def test_the_error_as_given_has_its_name(
    plain: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last = Quality(0.224, 0.0177, 0.291), Quality(0.1, 0.01, 0.12)
    found = ("board_shape",)
    finding = Diagnosis(0.016, "", (), (), found, first, last, 0.0, "", (), given_held_out_px=0.266)
    print_diagnosis(finding, plain)
    printed = capsys.readouterr().out
    assert 'so it may differ a\nlittle from the row "fitted cover" of calib fit.' in printed
    rows = [line for line in printed.splitlines() if " px" in line]
    assert "given fit" in rows[0]
    assert "0.266 px" in rows[0]
    assert "plain fit" in rows[1]
    assert "0.291 px" in rows[1]
    assert "with effects" in rows[2]


def test_a_diagnosis_that_found_nothing_has_one_error(
    plain: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    error = Quality(0.224, 0.0177, 0.291)
    print_diagnosis(Diagnosis(0.016, "", (), (), (), error, error, 0.0, "", ()), plain)
    lines = capsys.readouterr().out.splitlines()
    rows = [line for line in lines if " px" in line]
    assert len(rows) == 2, "the error and the noise"
    assert "this fit" in rows[0]
    assert lines[-2] == "What was considered", "no columns without figures"


@pytest.mark.parametrize("is_added", [False, True])
def test_effects_that_the_calibration_had_are_not_found_again(
    is_added: bool, plain: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last = Quality(0.224, 0.0177, 0.291), Quality(0.1, 0.01, 0.12)
    accepted = ("board_shape", *(["board_scale"] * is_added))
    finding = Diagnosis(
        0.016, "", (), (), accepted, first, last, 0.0, "", (), earlier=("board_shape",)
    )
    print_diagnosis(finding, plain)
    printed = " ".join(capsys.readouterr().out.split())
    assert "plain fit" not in printed.lower()
    if is_added:
        assert printed.startswith("Found beside board_shape: board_scale.")
        assert "earlier effects │" in printed
    else:
        assert printed.startswith("Nothing found beside board_shape: no known effect improves")
        assert "with effects" not in printed
