"""A verdict on the terminal: the last lines of stdout."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calib.errors import harmless
from calib.verdict.verdict import Verdict


def print_verdict(verdict: Verdict, written: Sequence[Path]) -> None:
    """Where the results are, then whether to trust them, why not, and what to type next."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    for path in written:
        console.print(harmless(f"Wrote {path}"))
    console.print(verdict.word.sentence, style="bold")
    for reason in verdict.reasons:
        console.print(harmless(f"- {reason.sentence}"))
    console.print(harmless(f"Next: {verdict.next}"))
