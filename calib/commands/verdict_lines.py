"""A verdict on the terminal: the last lines of stdout."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calib.commands.program import as_typed
from calib.errors import harmless
from calib.verdict.verdict import Trust, Verdict


def print_verdict(verdict: Verdict, written: Sequence[Path], further: Sequence[str] = ()) -> None:
    """Where the results are, then whether to trust them, why not, and what to type next.

    Args:
        further: commands that go on from a calibration that may be used.
    """
    console = Console(markup=False, highlight=False, soft_wrap=True)
    for path in written:
        console.print(harmless(f"Wrote {path}"))
    console.print(verdict.word.sentence, style="bold")
    for reason in verdict.reasons:
        console.print(harmless(f"- {reason.sentence}"))
    console.print(harmless(f"Next: {as_typed(verdict.next)}"))
    if further and verdict.word is not Trust.DO_NOT_USE:
        console.print(
            harmless(f"Then: {'; '.join(as_typed(one) for one in further if one != verdict.next)}")
        )
