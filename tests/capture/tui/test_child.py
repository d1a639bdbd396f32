"""Work in a separate process: its events, and how its end differs from its death."""

import os
import signal
import time

import pytest

from calib.errors import InputError
from calib.progress import Progress
from capture.tui.child import Child, Work


def no_board(progress: Progress) -> dict[str, object]:
    progress.task("One", 1)
    raise InputError("No board.")


def no_library(progress: Progress) -> dict[str, object]:
    progress.task("One", 1)
    raise ImportError("No module named torch")


def ended_by(progress: Progress, number: int) -> dict[str, object]:
    progress.task("One", 1)
    os.kill(os.getpid(), number)
    time.sleep(60)
    return {}


def a_bug(progress: Progress) -> dict[str, object]:
    progress.task("One", 1)
    raise ValueError("odd")


def silent(progress: Progress) -> dict[str, object]:
    progress.task("One", 1)
    os._exit(1)


def well(progress: Progress, views: int) -> dict[str, object]:
    progress.task("One", 2)(1, "0.121 px")
    return {"views": [0.1] * views}


def slow(progress: Progress) -> dict[str, object]:
    progress.task("One", 1)
    time.sleep(60)
    return {}


@pytest.mark.parametrize(
    ("work", "arguments", "sentence"),
    [
        (no_board, (), "No board."),
        (no_library, (), "This machine cannot fit (No module named torch): install torch"),
        (ended_by, (signal.SIGKILL,), "ended from outside (SIGKILL, perhaps for want of memory)"),
        (ended_by, (signal.SIGTERM,), "ended from outside (SIGTERM)"),
        (a_bug, (), "which is a bug in capture (ValueError: odd)"),
        (silent, (), "which is a bug in capture (it printed nothing)"),
    ],
)
def test_every_end_is_a_sentence(work: Work, arguments: tuple[object, ...], sentence: str) -> None:
    events = list(Child(work, *arguments).events())
    assert [event["event"] for event in events] == ["task", "error"]
    assert sentence in events[-1]["sentence"]


def test_a_result_is_the_end() -> None:
    assert list(Child(well, 2).events()) == [
        {"event": "task", "title": "One", "total": 2},
        {"event": "step", "done": 1, "words": "0.121 px"},
        {"event": "result", "views": [0.1, 0.1]},
    ]


def test_a_killed_child_sends_no_further_message() -> None:
    child = Child(slow)
    events = child.events()
    assert next(events)["title"] == "One"
    child.kill()
    assert list(events) == []
    early = Child(well, 1)
    early.kill()
    assert list(early.events()) == []
    assert early.pid == 0
