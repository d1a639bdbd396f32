"""The last lines on stdout, with the verdict."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calib.commands.program import runnable_command
from calib.errors import harmless
from calib.io.result_names import CALIBRATION_ARRAYS, CALIBRATION_FILE
from calib.verdict.next_commands import HOLDOUT, HOLDOUT_NOTE, NEW_FILM, TESTED_NOTE
from calib.verdict.verdict import Trust, Verdict

COLOURS = {Trust.TRUSTED: "green", Trust.CARE: "yellow", Trust.DO_NOT_USE: "red"}
"""The colour of each grade in a terminal."""
RIG_HOLDOUT_NOTE = "HOLDOUT is the folder of another recording of this rig."

FILM_NOTE = (
    f"{NEW_FILM} is a new video: film the board again with this camera, and give the options that"
    " you gave for the earlier one."
)


def print_verdict(verdict: Verdict, written: Sequence[Path], further: Sequence[str] = ()) -> None:
    """Print the paths of the results and, after an empty line, whether to trust them, why not, and
    the next command.

    Args:
        further: commands that use a calibration which the verdict allows.
    """
    console = Console(markup=False, highlight=False, soft_wrap=True)
    for path in written:
        arrays = f" and {CALIBRATION_ARRAYS}" if path.name == CALIBRATION_FILE else ""
        console.print(harmless(f"Wrote {path}{arrays}"))
    console.print()
    console.print(verdict.headline, style=f"bold {COLOURS[verdict.word]}")
    for reason in verdict.reasons:
        console.print(harmless(f"- {reason.sentence}"))
    for note in verdict.notes:
        console.print(harmless(f"Note: {note}"))
    commands = verdict.labelled_commands(further)
    labels = [label for label, _ in commands]
    for place, (label, command) in enumerate(commands):
        start = " " * len(f"{label}:") if label in labels[:place] else f"{label}:"
        console.print(harmless(f"{start} {runnable_command(command)}"))
    if any(HOLDOUT in command.split() for _, command in commands):
        is_rig = verdict.next.startswith("calib rig ")
        note = TESTED_NOTE if verdict.is_tested else HOLDOUT_NOTE
        console.print(RIG_HOLDOUT_NOTE if is_rig else note)
    if NEW_FILM in verdict.next.split():
        console.print(FILM_NOTE)
