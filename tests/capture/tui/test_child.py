"""A process that calculates: what it says, and how its end is told apart from its death."""

import json
import sys
from pathlib import Path

import pytest

from capture.tui.child import Child, Event

SAYS = 'import json, os, signal, sys, time\nprint(json.dumps({"event": "task", "title": "One", "total": 1}), flush=True)\n'


@pytest.mark.parametrize(
    ("then", "sentence"),
    [
        ('print(json.dumps({"event": "error", "sentence": "No board."}))', "No board."),
        ("os.kill(os.getpid(), signal.SIGKILL)", "ended from outside (SIGKILL, perhaps for want of memory)"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "ended from outside (SIGTERM)"),
        ("raise ValueError('odd')", "which is a bug in capture (ValueError: odd)"),
        ("pass", "which is a bug in capture (it said nothing)"),
    ],
)
def test_every_end_is_a_sentence(then: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events = _run(SAYS + then, tmp_path, monkeypatch)
    assert [event["event"] for event in events] == ["task", "error"]
    assert sentence in events[-1]["sentence"]


def test_a_result_is_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = {"event": "result", "views": []}
    assert _run(f"{SAYS}print('''{json.dumps(result)}''')", tmp_path, monkeypatch)[-1] == result


def test_one_that_was_killed_says_nothing_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    child = _child(f"{SAYS}time.sleep(60)", tmp_path, monkeypatch)
    events = child.events()
    assert next(events)["title"] == "One"
    child.kill()
    assert list(events) == []
    early = _child("raise SystemExit", tmp_path, monkeypatch)
    early.kill()
    assert list(early.events()) == []


def _run(code: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Event]:
    return list(_child(code, folder, monkeypatch).events())


def _child(code: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Child:
    (folder / "stand_in.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=":")
    assert sys.executable
    return Child("stand_in", [])
