"""The result of the check of a rig on the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.checking.result import CheckStatus
from calib.checking.significance import ALPHA
from calib.commands.check_lines import error_words, p_text
from calib.commands.left_out_lines import left_out_lines
from calib.commands.program import runnable_command
from calib.errors import harmless
from calib.io.shell import shell_line, shell_path
from calib.rig.check_result import CONTRADICTION, RigCheckResult
from calib.rounding import with_sigma

MIN_PLACEMENTS = 3
"""The fewest placements that a check should have."""
SENTENCES = {
    CheckStatus.VALID: "The rig is valid.",
    CheckStatus.UNDECIDED: "These pictures do not show whether the rig is valid.",
    CheckStatus.DEGRADED: "The rig is degraded.",
    CheckStatus.BROKEN: "The rig is broken for these pictures.",
}


NOT_CHECKED = "Not checked: the rig was made from these pictures, or from most of them."


def print_rig_check(result: RigCheckResult, following: str) -> None:
    """Print the status, the reasons, the pose of each camera, and the next command."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    is_known = result.status is CheckStatus.VALID and result.is_known
    console.print(NOT_CHECKED if is_known else SENTENCES[result.status], style="bold")
    for line in rig_check_lines(result):
        console.print(line)
    if result.places:
        console.print(_table(result))
    console.print(harmless(f"Next: {runnable_command(following)}"))


def next_rig_command(result: RigCheckResult, rig: Path, pictures: Path) -> str:
    """Return the command to type next: the errors on these pictures of a rig that holds, a new
    recording of one that does not, and the same check of pictures whose pairing is to be corrected.
    """
    if result.status is CheckStatus.VALID:
        return shell_line("calib", "rig", "evaluate", rig, pictures)
    if any(change.change.name == CONTRADICTION for change in result.changes):
        return shell_line("calib", "rig", "check", rig, pictures)
    session = pictures if pictures.is_dir() else pictures.parent
    if not session.name.strip("."):  # "." and ".." are not names
        session = session.resolve()
    recording = session.with_name(f"{session.name}-again")
    return f"capture {shell_path(recording)} --source NAME=SOURCE ..."


def rig_check_lines(result: RigCheckResult) -> Iterator[str]:
    """Yield the reasons for the status as harmless text."""
    for line in _reasons(result):
        yield harmless(f"- {line}")
    pictures = ((f"{view.file} of {view.camera}", view.reason) for view in result.rejected)
    yield from map(harmless, left_out_lines(pictures, "Left out"))


def _reasons(result: RigCheckResult) -> Iterator[str]:
    statistics = result.statistics
    if statistics:
        yield (
            f"the error on {result.placements} placement{'s' * (result.placements > 1)} with one"
            f" pose of the board for all cameras is {error_words(statistics)};"
            f" {statistics.expected_px:.3f} px are expected and up to"
            f" {statistics.allowed_px:.3f} px allowed."
        )
    yield (
        f"cameras and mountings together: p {p_text(result.p_value)}; less than {ALPHA:g} is an"
        " alarm."
    )
    alone = len(result.changes) == 1
    for change in result.changes:
        probability = change.change.probability
        yield f"{change.change}." if alone else f"{100 * probability:.0f} %: {change.change}."
    for name, reason in result.unplaced.items():
        yield f"{name} is not compared with the other cameras: {reason}."
    if result.is_pair and any(change.camera in result.places for change in result.changes):
        (name,) = result.places
        yield f"two cameras do not show which of them moved: {name}, or {result.base} instead."
    if result.placements < MIN_PLACEMENTS:
        yield (
            "that is few: three to five placements of a tilted board, near and far, which all"
            " cameras see, give a better check."
        )


def _table(result: RigCheckResult) -> Table:
    title = f"Each camera against where it was, seen from {result.base}"
    table = Table("camera", "moved", "turned", "sigmas", title=title)
    for column in table.columns[1:]:
        column.justify = "right"
    for name, place in result.places.items():
        moved = with_sigma(1000 * place.moved[0], 1000 * place.moved[1])
        turned = with_sigma(*np.degrees(place.turned).tolist())
        table.add_row(name, f"{moved} mm", f"{turned} degrees", f"{place.z:.1f}")
    return table
