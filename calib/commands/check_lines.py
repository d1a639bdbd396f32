"""The answer of a check on the terminal."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from calib.checking.answer import Answer, Word
from calib.checking.significance import ALPHA
from calib.checking.update import Moved
from calib.commands.program import as_typed
from calib.errors import harmless
from calib.fitting.rounding import with_sigma

NOISIER = 1.3
"""Times the noise of the calibration's own corners, from which a person is told of it."""

FEWEST = 3
"""Views that a check should have."""
SMALLEST_P = 1e-99
"""That is told as a number: smaller ones underflow."""


def print_answer(
    answer: Answer, moved: Sequence[Moved], written: Sequence[Path], following: str
) -> None:
    """The word, the figure that it rests on, what has changed, what an update moved, and what to
    type next.
    """
    console = Console(markup=False, highlight=False, soft_wrap=True)
    console.print(answer.word.sentence, style="bold")
    for line in answer_lines(answer, moved):
        console.print(line)
    for path in written:
        console.print(harmless(f"Wrote {path}"))
    console.print(harmless(f"Next: {as_typed(following)}"))


def next_command(
    answer: Answer, calibration: Path, pictures: Sequence[Path], *, updated: bool
) -> str:
    """What to type next: a valid or updated calibration is looked at and put to use, and what is
    not valid is recorded anew.
    """
    if answer.lacking and not updated:
        return f"calib diagnose {shlex.quote(str(calibration))}"
    if updated or answer.word is Word.VALID:
        return f"calib report {shlex.quote(str(calibration))}"
    session = pictures[0] if pictures[0].is_dir() else pictures[0].parent
    named = (
        session if session.name.strip(".") else session.resolve()
    )  # "." and ".." have no name of their own
    return f"capture {shlex.quote(str(named.with_name(f'{named.name}-again')))}"


def answer_lines(answer: Answer, moved: Sequence[Moved] = ()) -> Iterator[str]:
    """What the word rests on, for people, harmless."""
    for line in _reasons(answer):
        yield harmless(f"- {line}")
    for one in answer.rejected:
        yield harmless(f"Left out {one.name}: {one.reason}")
    for number in moved:
        before, after = (
            with_sigma(number.before, number.sigma_before),
            with_sigma(number.after, number.sigma_after),
        )
        yield (
            f"{number.name}: {before} -> {after} {number.unit}".rstrip()
            + f" ({number.sigmas:+.1f} sigma)"
        )


def _reasons(answer: Answer) -> Iterator[str]:
    if answer.views:
        views = f"{answer.views} view{'s' * (answer.views > 1)}"
        yield (
            f"{answer.error_px:.3f} px are left on {views}, where {answer.expected_px:.3f} px are"
            f" expected and up to {answer.allowed_px:.3f} px allowed; p {_p(answer.p_value)}, where"
            f" less than {ALPHA:g} is an alarm."
        )
        if answer.word is not Word.VALID:
            yield f"the change adds {answer.added_px:.3f} px to the corners."
        if answer.louder > NOISIER:
            yield (
                f"the corners are {answer.louder:.1f} times as noisy as those of the calibration:"
                " sharper pictures tell more."
            )
        if answer.known:
            those = "they are" if answer.known == answer.views else f"{answer.known} of them are"
            yield (
                f"{those} of pictures that the calibration was made from, which say nothing of"
                " today: take new ones."
            )
        if answer.views < FEWEST:
            yield (
                "that is little to go by: three to five views of a tilted board, near and far, tell"
                " more."
            )
    alone = len(answer.changes) == 1
    for change in answer.changes:
        yield f"{change}." if alone else f"{100 * change.probability:.0f} %: {change}."
    if answer.lacking:
        yield (
            f"the calibration's own views show {answer.lacking} as well: it may be no change, but"
            " what the model has always lacked."
        )


def _p(value: float) -> str:
    return f"= {value:.2g}" if value > SMALLEST_P else f"< {SMALLEST_P:g}"
