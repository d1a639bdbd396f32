"""A short fuzz of every kind of input, the same cases each time; `python -m tests.fuzz` is the long
one.
"""

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import MAX_MESSAGE, InputError, brief, harmless
from tests.fuzz.__main__ import fuzz
from tests.fuzz.cases import Bench, Kind, each_of, spoil
from tests.fuzz.limits import Hang, Limits

CASES = 12
"""The number of cases of each kind; a wrong place that one spoilt file in twelve finds is found
here, a rarer one by the command.
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("fuzz"))


def test_every_spoilt_input_gets_a_sentence(bench: Bench) -> None:
    def check(kind: Kind, value: Any) -> None:
        with warnings.catch_warnings(action="error"):
            spoil(kind, value)

    for kind in bench.kinds:
        each_of(kind, CASES, partial(check, kind))


@given(st.text(), st.integers(4, 200))
def test_foreign_text_is_one_line_that_can_be_shown(text: str, limit: int) -> None:
    shown = harmless(text, limit)
    assert shown.isprintable()
    shown.encode()
    assert harmless(text) == text or not text.isprintable(), "what does no harm is left as it is"
    assert len(str(InputError(text * 100))) <= MAX_MESSAGE
    assert len(harmless(text)) >= len(text)


def test_control_characters_are_escaped() -> None:
    assert harmless("a\x1b[2J\ncalib: all is well") == r"a\x1b[2J\ncalib: all is well"
    assert harmless("caf\udce9.png") == r"caf\xe9.png"
    assert harmless("gnp\u202e.exe\u2028\ufeff") == r"gnp\u202e.exe\u2028\ufeff"
    assert harmless("Kölner Dom 大\u00a0") == "Kölner Dom 大 "
    assert brief("x" * 100) == "x" * 77 + "..."
    long = str(InputError("begin " + "y" * 10**6 + " and what to do."))
    assert long.startswith("begin y")
    assert long.endswith("y and what to do.")


def test_the_same_cases_every_time(bench: Bench) -> None:
    kind = next(kind for kind in bench.kinds if kind.name == "frames.csv")
    runs: list[list[bytes]] = [[], []]
    for run in runs:
        each_of(kind, CASES, run.append)
    assert runs[0] == runs[1]


@pytest.fixture
def limits() -> Iterator[Limits]:
    """Set limits of a fifth of a second; pytest's own handlers come back."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGPROF, signal.SIGALRM)}
    made = Limits()
    made.work_s, made.wait_s = 0.2, 60.0
    yield made
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _works(_: Any) -> None:
    while True:
        pass


def _waits(_: Any) -> None:
    handle, _write_end = os.pipe()
    os.read(handle, 1)


@pytest.mark.parametrize(("act", "says"), [(_works, "too much work"), (_waits, "it waits")])
def test_a_case_that_does_not_end_is_ended(
    limits: Limits, act: Callable[[Any], None], says: str
) -> None:
    limits.wait_s = 0.5 if act is _waits else 60.0
    with pytest.raises(Hang, match=says), limits:
        act(None)


def test_a_busy_machine_is_no_hang(limits: Limits) -> None:
    """Time without work."""
    with limits:
        time.sleep(2 * limits.work_s)


def test_wrong_outcomes_are_counted_and_can_be_repeated(limits: Limits) -> None:
    """Every kind of wrong, among cases that are right."""

    def run(value: int) -> object:
        match value:
            case 0:
                raise ValueError("a bug")
            case 1:
                raise AssertionError("500 characters: ...")
            case 2:
                warnings.warn("deprecated", stacklevel=1)
            case 3:
                _works(None)
            case 4:
                raise InputError("Write another number.")
        return value == 5

    tally = fuzz(Kind("numbers", st.integers(0, 6), run), 100, 3, limits)
    assert (tally.tried, tally.refused, tally.wrong.total()) == (7, 2, 4)
    message = tally.explained()
    for wrong in ("ValueError", "AssertionError", "UserWarning", "Hang"):
        assert f"numbers: {wrong} at here" in message
    assert "python -m tests.fuzz --seed 3 --cases 100 --kind 'numbers'" in message


def test_another_seed_gives_other_cases(bench: Bench) -> None:
    kind = next(kind for kind in bench.kinds if kind.name == "frames.csv")
    runs: list[list[bytes]] = [[], []]
    for number, run in enumerate(runs):
        each_of(kind, CASES, run.append, number)
    assert runs[0] != runs[1]


@pytest.mark.slow
@pytest.mark.slow
def test_the_command_sums_up_and_tells_an_unknown_kind() -> None:
    command = [sys.executable, "-m", "tests.fuzz", "--cases", "4"]
    done = subprocess.run(
        [*command, "--kind", "frames.csv"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].endswith("0 went wrong, in 0 ways")
    assert "4 cases of 1 kinds" in done.stdout
    unknown = subprocess.run(
        [*command, "--kind", "nothing"], capture_output=True, text=True, check=False
    )
    assert unknown.returncode == 2
    assert "there are: something else than a file; --depth;" in unknown.stderr
