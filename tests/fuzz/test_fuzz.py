"""A short fuzz of every kind of input, the same cases each time; `python -m tests.fuzz` is the long one."""

import warnings
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import LONGEST, InputError, brief, harmless
from tests.fuzz.cases import Bench, Kind, each_of, spoil

CASES = 12
"""Of each kind; a wrong place that one spoilt file in twelve finds is found here, a rarer one by the command."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("fuzz"))


def test_whatever_is_spoilt_is_said_in_a_sentence(bench: Bench) -> None:
    def check(kind: Kind, value: Any) -> None:
        with warnings.catch_warnings(action="error"):
            spoil(kind, value)

    for kind in bench.kinds:
        each_of(kind, CASES, partial(check, kind))


@given(st.text(), st.integers(4, 200))
def test_foreign_text_is_one_line_that_can_be_shown(text: str, most: int) -> None:
    said = harmless(text, most)
    assert said.isprintable()
    said.encode()
    assert harmless(text) == text or not text.isprintable(), "what does no harm is left as it is"
    assert len(str(InputError(text * 100))) <= LONGEST
    assert len(harmless(text)) >= len(text)


def test_what_is_escaped() -> None:
    assert harmless("a\x1b[2J\ncalib: all is well") == r"a\x1b[2J\ncalib: all is well"
    assert harmless("caf\udce9.png") == r"caf\xe9.png"
    assert harmless("gnp\u202e.exe\u2028\ufeff") == r"gnp\u202e.exe\u2028\ufeff"
    assert harmless("Kölner Dom 大\u00a0") == "Kölner Dom 大 "
    assert brief("x" * 100) == "x" * 77 + "..."
    long = str(InputError("begin " + "y" * 10**6 + " and what to do."))
    assert long.startswith("begin y")
    assert long.endswith("y and what to do.")


def test_the_same_cases_every_time(bench: Bench) -> None:
    (kind,) = (kind for kind in bench.kinds if kind.name == "frames.csv")
    runs: list[list[bytes]] = [[], []]
    for run in runs:
        each_of(kind, CASES, run.append)
    assert runs[0] == runs[1]
