"""The diagnosis of a rig on the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

from calib.effects.effect import EACH_VIEW
from calib.errors import harmless
from calib.rig.rig_finding import RigCandidate, RigDiagnosis

LOG_ODDS = "Log odds: 0 is as probable as no cause; each 2.3 more is ten times as probable."
"""The meaning of a column."""


def print_rig_diagnosis(diagnosis: RigDiagnosis) -> None:
    """Print what was found, the errors without and with it, all candidates and the remarks."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    if diagnosis.found:
        console.print(f"Found: {', '.join(diagnosis.accepted)}", style="bold")
    else:
        console.print("Nothing found.", style="bold")
    for effect in diagnosis.found:
        console.print(harmless(f"- {effect.sentence}."))
    console.print(_errors(diagnosis))
    console.print(_candidates(diagnosis))
    console.print(LOG_ODDS)
    for line in diagnosis_lines(diagnosis):
        console.print(harmless(line))


def diagnosis_lines(diagnosis: RigDiagnosis) -> Iterator[str]:
    """Yield the remarks."""
    yield from map(str, diagnosis.families)
    for remark in diagnosis.remarks:
        yield f"Note: {remark}"


def _errors(diagnosis: RigDiagnosis) -> Table:
    title = "Error (root mean square, one pose of the board for all cameras)"
    table = Table("", "fitted placements", "held-out placements", title=title)
    for column in table.columns[1:]:
        column.justify = "right"
    rows = (("without effects", diagnosis.before), ("with effects", diagnosis.after))
    for name, quality in rows:
        table.add_row(name, f"{quality.rms_px:.3f} px", f"{quality.held_out_px:.3f} px")
    return table


def _candidates(diagnosis: RigDiagnosis) -> Table:
    title = f"What was considered, with {diagnosis.placements} placements"
    table = Table("cause", "camera", "log odds", "held out, px", "", title=title)
    table.columns[2].justify = "right"
    for candidate in diagnosis.candidates:
        table.add_row(
            candidate_title(candidate),
            harmless(candidate.camera),
            f"{round(candidate.log_odds)}",
            _held_out(candidate),
            candidate.verdict,
        )
    return table


def candidate_title(candidate: RigCandidate) -> str:
    """Return an effect's name, and how it varies if it has other forms."""
    is_form = candidate.effect == "sync_offset" and candidate.varies == EACH_VIEW
    return f"{candidate.effect}, each view" if is_form else candidate.effect


def _held_out(candidate: RigCandidate) -> str:
    error, error_with_it = candidate.held_out_px_before, candidate.held_out_px_after
    if error is None or error_with_it is None:
        return ""
    return f"{error:.3f} → {error_with_it:.3f}"
